// The queue of campaigns that are to run next: shown, edited, started and halted.

import { ask } from "./dialog.js";
import { preview } from "./preview.js";
import { clock, element } from "./words.js";

const by = (id) => document.getElementById(id);

// Tells an entry that is to be added from all others.
const mark = () => Array.from(crypto.getRandomValues(new Uint8Array(12)), (byte) => byte.toString(16).padStart(2, "0")).join("");

export class QueueCard {
  // order: gives an order to the console and shows what came of it; isMine: whether this page has control;
  // say: shows a sentence.
  constructor(link, order, isMine, say) {
    this.say = say;
    this.link = link;
    this.order = order;
    this.isMine = isMine;
    this.shown = "";
    this.unsure = null; // what was to be added as the console did not answer: {name, text}
    by("queue-add").addEventListener("click", () => this.add());
    by("queue-start").addEventListener("click", () => this.start());
    by("queue-halt").addEventListener("click", () => this.order("queue halt"));
  }

  // Why an order may not be given: the role, or that somebody else has control; empty if it may.
  why(name) {
    if (this.link.lost) return "The console does not answer.";
    if (this.link.mayNot[name]) return `Not possible: ${this.link.mayNot[name]}.`;
    return this.isMine() ? "" : "Take control to change the queue.";
  }

  show() {
    const { queue, launch } = this.link.common;
    by("queue-card").hidden = !launch?.allowed;
    if (!queue || !launch?.allowed) return;
    this.settle(queue);
    const key = JSON.stringify([queue, this.why("queue add"), launch.offers.length]);
    if (key === this.shown) return;
    this.shown = key;
    const count = queue.entries.length;
    by("queue-state").textContent = [
      count === 0 ? "Empty." : queue.by ? `Worked off, as ${queue.by} wants it: the next one starts when nothing runs.` : "Nothing of it starts before somebody starts the queue.",
      queue.why ? `${queue.why[0].toUpperCase()}${queue.why.slice(1)}.` : "",
    ].join(" ");
    by("queue-entries").replaceChildren(...queue.entries.map((entry, k) => this.entry(entry, k, count)));
    by("queue-add").disabled = Boolean(this.why("queue add")) || launch.offers.length === 0;
    by("queue-start").hidden = Boolean(queue.by);
    by("queue-start").disabled = Boolean(this.why("queue start")) || count === 0;
    by("queue-halt").hidden = !queue.by;
    by("queue-halt").disabled = Boolean(this.why("queue halt"));
    for (const name of ["add", "start", "halt"]) by(`queue-${name}`).title = this.why(`queue ${name}`);
  }

  entry(entry, place, count) {
    const told = { name: String(entry.number) };
    const button = (text, label, isThere, act, why = "") => {
      const made = element("button", "plain", text);
      made.type = "button";
      made.setAttribute("aria-label", `${entry.campaign}, number ${entry.number}: ${label}`);
      made.title = why || label;
      made.disabled = !isThere || Boolean(why);
      made.addEventListener("click", act);
      return made;
    };
    const name = element("button", "plain name", entry.campaign);
    name.type = "button";
    name.title = "What its start would do";
    name.addEventListener("click", () => this.look(entry.campaign));
    return element("li", "",
      element("span", "", name, element("span", "quiet", `by ${entry.by}, ${clock(entry.at_ms)}${entry.begun ? "; was about to be started when the console ended" : ""}`)),
      element("span", "moves",
        button("↑", "earlier", place > 0, () => this.order("queue move", { ...told, text: "earlier" }), this.why("queue move")),
        button("↓", "later", place < count - 1, () => this.order("queue move", { ...told, text: "later" }), this.why("queue move")),
        button("✕", "remove", true, () => this.order("queue remove", told), this.why("queue remove"))));
  }

  look(campaign) {
    ask({ title: `What ${campaign} would do`, confirm: "Close", isWide: true, shown: (place) => preview(place, campaign) });
  }

  async add() {
    const { offers } = this.link.common.launch;
    const told = await ask({
      title: "Queue a campaign", confirm: "Queue it", isWide: true,
      text: "It waits at the end of the queue. Below is what its start would do.",
      choice: { label: "Campaign", options: offers.map((offer) => [offer.name, `${offer.name}, on ${offer.rig}`]) },
      shown: preview,
    });
    if (!told) return;
    // Asked for once more, after no answer came, it is the same entry and is not added twice.
    const asked = this.unsure?.name === told.name ? this.unsure : { name: told.name, text: mark() };
    this.unsure = asked;
    const { answered } = await this.order("queue add", asked);
    if (answered) this.unsure = null;
    else this.show();
  }

  // Says whether what the console did not answer was done, once it tells the queue anew.
  settle(queue) {
    if (!this.unsure || this.link.lost || !queue.marks.includes(this.unsure.text)) return;
    this.say(`${this.unsure.name} was queued, although the console did not answer.`);
    this.unsure = null;
  }

  async start() {
    const first = this.link.common.queue.entries[0];
    const told = await ask({
      title: "Start the queue", confirm: "Start the queue", isWide: true,
      text: `${first.campaign} begins as soon as nothing runs, then one after another: the ram moves without anybody being asked again. A stop, a trip or a run that did not come to its end halts the queue.`,
      shown: (place) => preview(place, first.campaign),
    });
    // What was shown is what begins; the console refuses if something else has come first since.
    if (told) await this.order("queue start", { name: String(first.number) });
  }
}
