// The page: shows what the console tells, and asks it for what the operator wants.

import { Alarm } from "./alarm.js";
import { Chart } from "./chart.js";
import { ask } from "./dialog.js";
import { FURTHER, History } from "./history.js";
import { Link } from "./link.js";
import { EXPIRED, limit, offerLogin } from "./people.js";
import { lastState, rigState } from "./rig_state.js";
import { Manual } from "./manual.js";
import { preview } from "./preview.js";
import { QueueCard } from "./queue.js";
import { Trigger } from "./trigger.js";
import { isOfAnother, ofStation, shownUse, underWay, trippedRuns, waitsToBeSeen } from "./uses.js";
import * as views from "./views.js";
import { answered, capital, clock, element, lasted } from "./words.js";

const by = (id) => document.getElementById(id);
const SILENT_MS = 1500;

const CHARTS = {
  motion: {
    title: "Position", unit: "mm", least: 5, floor: null,
    series: [
      { key: "setpoint_mm", label: "setpoint", colour: "reference", dash: [5, 4], width: 1.6, digits: 1 },
      { key: "position_mm", label: "position", colour: "first", digits: 1 },
    ],
  },
  pressures: {
    title: "Chamber pressures", unit: "MPa", least: 1, floor: 0,
    series: [
      { key: "supply_MPa", label: "supply", colour: "reference", width: 1.2, digits: 2 },
      { key: "pressure_1_MPa", label: "1 measured", colour: "first-pale", width: 2.6, digits: 2 },
      { key: "pressure_2_MPa", label: "2 measured", colour: "second-pale", width: 2.6, digits: 2 },
      { key: "estimate_1_MPa", label: "1 estimated", colour: "first", width: 1.1, digits: 2 },
      { key: "estimate_2_MPa", label: "2 estimated", colour: "second", width: 1.1, digits: 2 },
    ],
  },
  residuals: {
    title: "Residuals, mean over 4 s", unit: "kPa", least: 20, floor: 0,
    series: [
      { key: "average_1_kPa", label: "chamber 1", colour: "first", digits: 1 },
      { key: "average_2_kPa", label: "chamber 2", colour: "second", digits: 1 },
    ],
  },
  leak: {
    title: "Leak flow, with 95 % interval", unit: "L/min", least: 0.2, floor: 0,
    series: [
      { key: "leak_L_per_min", label: "estimated", colour: "leak", digits: 3,
        band: ["leak_low_L_per_min", "leak_high_L_per_min"] },
    ],
  },
  further: FURTHER,
};

const charts = {};
for (const figure of document.querySelectorAll("[data-chart]")) {
  charts[figure.dataset.chart] = new Chart(figure, CHARTS[figure.dataset.chart]);
}

// What has changed is drawn with the next frame of the screen; where a machine is too slow for that,
// less often, so that half of its time is left for the operator.
const dirty = new Set();
let drawing = false;
let drawAgainAt = 0;
let askedAt = 0;
const FRAME_MS = 20;

function frame() {
  askedAt = performance.now();
  requestAnimationFrame(render);
}

const link = new Link((changed) => {
  for (const name of changed) dirty.add(name);
  if (!drawing) {
    drawing = true;
    const wait = drawAgainAt - performance.now();
    if (wait > 0) setTimeout(frame, wait);
    else frame();
  }
});
window.rigConsole = link; // for whoever looks at it from the browser's own tools
const manual = new Manual(link);
const alarm = new Alarm(by("silence"));
window.rigConsoleAlarm = alarm;

const history = new History(link, charts);
window.rigConsoleHistory = history;
const trigger = new Trigger(link, history);

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const chart of Object.values(charts)) { chart.resized = true; chart.redraw(); }
});

// What the chart of the leak says while it has no curve.
function noLeak({ campaign, decision }) {
  if (!history.isLive) return "no leak was estimated";
  return campaign?.status === "running" && decision?.verdict && campaign.tests.some((test) => test.status === "running") ? "no leak found" : "nothing is judged";
}

// What the chart of the position says while it has no curve.
function noPosition({ interlocks }) {
  const isUnknown = (interlocks?.contacts ?? []).some(({ name, text }) => name === "position" && text === "not homed");
  return history.isLive && isUnknown ? "not homed: where the ram is, is not known" : "";
}

function render() {
  drawing = false;
  const begun = performance.now();
  const { sections, common } = link;
  if (dirty.has("rig")) { charts.residuals.levels = []; views.clear(charts); manual.clear(); history.begin(); trigger.disarm("Off: another rig is shown."); }
  charts.leak.empty = noLeak(sections);
  charts.motion.empty = noPosition(sections);
  if (dirty.has("points") && link.points && history.isLive) {
    for (const chart of Object.values(charts)) chart.draw(link.points);
    frames += 1;
  }
  if (dirty.has("bypass")) manual.show(isMine());
  if (dirty.has("decision")) {
    const levels = (sections.decision?.thresholds_kPa ?? []).filter((value) => value !== null);
    charts.residuals.levels = levels.map((value) => ({ value }));
  }
  for (const name of dirty) {
    if (views[name] && (name in sections || name in common)) views[name](link);
  }
  if (["life", "campaign", "progress", "holder", "launch", "rig", "rigs", "interlocks", "last", "role"].some((name) => dirty.has(name))) actions();
  if (["queue", "launch", "holder", "role"].some((name) => dirty.has(name))) queue.show();
  // What drove the rig last stands in the place of what its station does.
  if (dirty.has("last")) { dirty.add("campaign"); views.campaign(link); if (sections.interlocks) views.interlocks(link); }
  const stage = `${sections.life?.life} ${sections.life?.is_read} ${views.hasTripped(sections)}`;
  if (stage !== render.stage) {
    render.stage = stage;
    views.campaign(link);
    for (const name of ["interlocks", "bypass"]) if (name in sections) views[name](link);
    dirty.add("campaign");
  }
  if (["campaign", "progress"].some((name) => dirty.has(name))) views.queue(link);
  if (["decision", "progress", "campaign"].some((name) => dirty.has(name))) views.judged(link);
  if (["events", "notices"].some((name) => dirty.has(name))) views.happened(link);
  dirty.clear();
  alive();
  const ended = performance.now();
  link.drawMs = ended - begun;
  // A frame that comes late says that putting them on the screen takes what is there.
  drawAgainAt = ended + link.drawMs + Math.max(0, begun - askedAt - FRAME_MS);
}

// ---- what is so now -----------------------------------------------------------------------------

let frames = 0;
let stopTold = null;
export const drawn = () => frames;
window.rigConsoleFrames = drawn;

function alive() {
  const life = link.sections.life;
  const silent = performance.now() - link.heardAt;
  const lost = !link.open || silent > SILENT_MS;
  const pill = by("life");
  let [text, how] = ["no rig yet", "off"];
  if (link.expired) [text, how] = ["login expired", "off"];
  else if (lost) [text, how] = ["no console", "bad"];
  else if (life?.life === "live") [text, how] = [`live, ${life.rate_hz} samples/s`, views.hasTripped(link.sections) ? "bad" : "good"];
  else if (life?.life === "dead") [text, how] = [`dead for ${lasted(life.age_s)}`, "bad"];
  else if (life?.life === "ended") [text, how] = [`${link.sections.campaign?.activity ? "" : "campaign "}ended, ${lasted(life.age_s)} ago`, "off"];
  if (pill.textContent !== text) pill.textContent = text;
  pill.className = `pill ${how}`;
  const stale = lost || !life || life.life !== "live";
  document.body.classList.toggle("stale", stale);
  document.body.classList.toggle("unread", !life?.is_read);
  // What says above that it has tripped says so everywhere at once, however slowly a busy machine draws.
  const hasTripped = views.hasTripped(link.sections);
  if (hasTripped !== alive.hasTripped) {
    alive.hasTripped = hasTripped;
    if (life) views.life(link);
    views.campaign(link);
    views.queue(link);
  }
  if (lost !== link.lost) { link.lost = lost; actions(); queue.show(); }
  stands(lost, silent);
  banners(life);
}

function stands(lost, silent) {
  const [tone, word, why] = link.expired ? EXPIRED : rigState(link, lost, silent);
  const last = lost || link.expired ? null : lastState(link);
  if (link.expired) offerLogin();
  said("stop-told", stopTold);
  said("rig-state", [tone, word, why]);
  said("rig-last", last);
  // Before anything was told, or told anew, nothing is known to be right or wrong.
  if (lost && silent > SILENT_MS && link.heardAt || !lost && link.common.rigs && (link.sections.life || !link.common.rigs.length)) {
    if (tone !== "bad" && last?.[0] === "bad") alarm.take("bad", last[1], link.rig);
    else alarm.take(tone, word, link.rig);
  }
}

// Shows tone, word and sentence in the line of this name; without them the line is hidden.
function said(id, told) {
  const key = JSON.stringify(told);
  if (said[id] === key) return;
  said[id] = key;
  by(id).hidden = !told;
  if (!told) return;
  const [tone, word, why] = told;
  by(id).className = `banner ${tone}`;
  by(`${id}-word`).textContent = word;
  by(`${id}-why`).textContent = why;
  // A long reason is cut on the screen, and whole where a hand or a reader looks for it.
  by(id).title = why;
}

function banners(life) {
  const told = [];
  const { interlocks, progress, campaign } = link.sections;
  if (life?.life === "live" && interlocks?.sentence && !interlocks.first_out.length && life.state !== "holding") {
    told.push(["warn", capital(interlocks.sentence), ""]);
  }
  const run = underWay(link);
  const isRead = life?.life === "live" && campaign?.status === "idle" && !campaign.hands_over;
  const isElsewhere = run && !run.heard && (!ofStation(campaign) || isOfAnother(link, run));
  if (isElsewhere && !run.rig && life?.life === "live") {
    told.push(["warn", `${run.name} is under way`, `started here, as ${run.folder}; its rig is not heard yet.`]);
  } else if (run?.heard && isRead) {
    told.push(["off", `${run.name} writes its report`, "and has left the rig. Another one can be started in some seconds."]);
  }
  const key = JSON.stringify([told, progress?.number]);
  if (banners.shown === key) return;
  banners.shown = key;
  by("banners").replaceChildren(...told.map(([how, title, text]) =>
    element("p", `banner ${how}`, element("strong", "", title), " ", text)));
}
setInterval(alive, 250);

// ---- what may be done ---------------------------------------------------------------------------

const isMine = () => link.common.holder?.number !== null && link.common.holder?.number === link.you;

// Whoever has control is shown the rig that was started from here, once; he may look at another.
let followed = "";
function follow() {
  const run = underWay(link);
  if (!run?.rig || run.folder === followed || !isMine()) return;
  followed = run.folder;
  if (run.rig !== link.rig) link.choose(run.rig);
}

function actions() {
  follow();
  manual.show(isMine());
  const { life, campaign, progress, interlocks } = link.sections;
  const { holder, launch } = link.common;
  const isLive = life?.life === "live" && campaign?.status === "running";
  const canStart = launch?.allowed && !(isLive && launch.offers.length === 0);
  const isFree = canStart && !isLive && !underWay(link);
  const may = {
    start: isFree && launch.offers.length + unfinished().length > 0,
    reset: isFree && toReset() !== undefined,
    acknowledge: isLive && wantsAttention(link.sections) || unseen() !== undefined || waitsToBeSeen(link),
  };
  may.abort = isLive;
  may.note = isLive && !campaign.activity;
  // What would be refused, or come too late, is not offered.
  // What is done beside campaigns has no tests: it goes on to its end, or is aborted.
  const goesOn = isLive && !campaign.activity && life.state !== "tripped" && !interlocks?.first_out?.length;
  may.hold = goesOn && !campaign.pausing;
  may.resume = goesOn && campaign.pausing;
  may.set = isLive && Boolean(present());
  may.skip = goesOn && skippable().length > 0;
  may.retry = goesOn && repeatable().length > 0;
  for (const button of document.querySelectorAll("[data-do]")) {
    button.disabled = link.lost || !isMine() || !may[button.dataset.do];
  }
  by("rig-last-seen").hidden = !waitsToBeSeen(link) && !trippedRuns(link).length || !isMine();
  by("actions-why").textContent = link.lost ? "The console does not answer; nothing can be asked of it."
    : isMine()
    ? launch && !launch.allowed && !isLive ? "Campaigns are started on the rig's own machine." : may.start || may.reset ? startRefused() : ""
    : holder?.number === null ? "Take control to act. Stop works for everybody." : `${holder?.name ?? "Nobody"} has control. Stop works for everybody.`;
  by("stop").setAttribute("aria-label", `Stop ${link.rig || "the rig"}: end the campaign now`);
  by("stop-rig").textContent = (link.common.rigs?.length ?? 0) > 1 ? link.rig : "";
  by("progress-meter").hidden = !progress?.duration_s;
  limit(link, isMine());
  const mayAsk = link.role === null || isMine() || !link.mayNot.take;
  by("holder-button").disabled = link.lost || !holder || link.expired || !mayAsk;
}

const queue = new QueueCard(link, order, isMine, toast);
window.rigConsoleQueue = queue;

function toast(text, how = "") {
  const shown = element("p", `toast ${how}`, text);
  by("toasts").append(shown);
  setTimeout(() => shown.remove(), how === "bad" ? 12000 : 5000);
}

async function order(name, told) {
  const answer = await link.order(name, told);
  toast(answered(name, answer.accepted ? "" : answer.reason), answer.accepted ? "" : "bad");
  return answer;
}

async function stop() {
  // Whatever the page shows by the time of the answer: this is what the hand meant.
  const rig = link.rig || (link.expired ? link.chosen : "");
  const on = rig ? `${rig}: ` : "";
  const button = by("stop");
  button.classList.add("pressed");
  by("stop-word").textContent = "Stopping";
  stopTold = ["warn", `${on}Stop sent`, `at ${clock(Date.now())}; waiting for the rig's answer.`];
  alive();
  const answer = await link.order("stop", { rig });
  button.classList.remove("pressed");
  by("stop-word").textContent = "Stop";
  stopTold = answer.accepted
    ? ["warn", `${on}Stop obeyed`, `at ${clock(Date.now())}. Whatever moves is brought to rest; then valve null, bypass shut, pump unloaded.${answer.reason ? ` (${answer.reason})` : ""}`]
    : answer.reason.startsWith("nothing moves") ? ["warn", `${on}Nothing to stop`, `at ${clock(Date.now())}: ${answer.reason}.`]
    : ["bad", `${on}Stop not confirmed`, `${answer.reason}. If the rig moves, press the emergency stop at the rig.`];
  alive();
  setTimeout(() => { stopTold = null; alive(); }, answer.accepted ? 20000 : 60000);
}

by("stop").addEventListener("click", stop);
document.addEventListener("keydown", (event) => {
  if ((event.key === "F9" || event.key === "Pause") && !event.repeat) { event.preventDefault(); stop(); }
}, { capture: true });

// The run that is shown, or else that was started from here and was never heard.
function shownRun() {
  const { campaign } = shownUse(link);
  const last = link.common.launch?.last;
  const isLater = last && !last.heard && last.started_ms > (campaign?.begun_ms ?? 0);
  return isLater ? last.folder : campaign?.directory;
}

// The run that tripped or was stopped and can be gone on with: the one that is shown, or the newest
// one where none is. One that came to its end is not reset; older ones are gone on with by Start.
function toReset() {
  const shown = shownRun();
  return shown ? unfinished().find((run) => run.folder === shown) : unfinished()[0];
}

// The runs that can be gone on with. The console reads their journals now and then; that the run which is shown
// has come to its end, with or without a failed test, is heard before.
function unfinished() {
  const { campaign } = shownUse(link);
  const ended = campaign?.status === "ended" && [0, 1].includes(campaign.exit_code) ? campaign.directory : null;
  return (link.common.launch?.unfinished ?? []).filter((run) => run.folder !== ended);
}

// Why the rig that is shown would refuse a start; empty if nothing is known against it.
function startRefused() {
  const { life, interlocks } = link.sections;
  const isOpen = life?.life === "live" && interlocks?.contacts.some(({ name, text }) => name === "emergency stop" && text === "open");
  return isOpen ? `The emergency stop of ${link.rig} is open: nothing starts there before its button is released. ` : "";
}

// Whether something of a campaign that runs has failed, tripped or been held, so that somebody may say to have seen it.
function wantsAttention({ campaign, interlocks }) {
  const isAsExpected = (test) => !test.status || ["passed", "running", "not_run"].includes(test.status);
  return !campaign.activity && (campaign.pausing || campaign.held.length > 0 || interlocks?.first_out?.length > 0 || !campaign.tests.every(isAsExpected));
}

// The run that is shown, if it ended badly and nobody has acknowledged that.
const unseen = () => (link.common.launch?.unseen ?? []).find((run) => run.folder === shownRun());

// In the list of what may be started, a run to go on with; a campaign's name has no such character.
const GO_ON = "\n";
const named = (run) => `${run.campaign} (${run.folder})`;

const tests = () => link.sections.campaign?.tests ?? [];
const present = () => tests().find((test) => test.status === "running")?.name;
const skippable = () => tests().filter((test) => !test.status || test.name === present());
const repeatable = () => tests().filter((test) => test.status);
const DIALOGS = {
  start: () => ({
    title: "Start a campaign", confirm: "Start", isWide: true,
    shown: (place, name) => preview(place, name.startsWith(GO_ON) ? "" : name),
    text: startRefused() + "It begins at once: on hardware the rig is armed, and its reset button is waited for.",
    choice: { label: "Campaign", options: [
      ...link.common.launch.offers.map((offer) => [offer.name, `${offer.name}, on ${offer.rig}`]),
      ...unfinished().map((run) => [GO_ON + run.folder, `go on with ${named(run)}`])] },
  }),
  reset: () => ({
    title: "Reset and go on", confirm: "Go on",
    text: startRefused() + "The cause has been found and removed, and nobody is near the ram. The run goes on with its next unfinished test; on hardware the rig is armed anew, and its reset button is waited for.",
    choice: { label: "Run", options: [[toReset().folder, named(toReset())]] },
  }),
  hold: () => ({ title: "Hold the campaign", confirm: "Hold", remark: "Remark (recorded)",
    text: present() ? `It pauses after the present test, ${present()}, with the ram held.` : "The next test does not begin; the ram stays held." }),
  resume: () => ({ title: "Resume the campaign", confirm: "Resume", remark: "Remark (recorded)", text: "The next test begins: the ram moves." }),
  skip: () => ({
    title: "Skip a test", confirm: "Skip", remark: "Remark (recorded)",
    text: "The present test ends at once; another one is not run. It counts as skipped.",
    choice: { label: "Test", options: skippable()
      .map((test) => [test.name, test.name === present() ? `${test.name} (runs)` : test.name])
      .sort((one) => (one[0] === present() ? -1 : 0)) },
  }),
  retry: () => ({
    title: "Run a test again", confirm: "Retry", remark: "Remark (recorded)",
    text: "The present test begins anew; one that has ended is run again. What was found before does not count.",
    choice: { label: "Test", options: repeatable()
      .map((test) => [test.name, test.name === present() ? `${test.name} (runs)` : `${test.name} (${test.status})`])
      .sort((one) => (one[0] === present() ? -1 : 0)) },
  }),
  acknowledge: () => ({ title: "Acknowledge", confirm: "Acknowledge", remark: "What was seen (recorded)",
    text: "What failed, tripped, was interrupted or held was seen by you; the record names you." }),
  note: () => ({ title: "Note", confirm: "Keep", remark: "Goes into journal, recording and report", needed: true }),
  set: () => ({ title: "Set the control of the test that runs", confirm: "Set", needed: true,
    remark: "Settings (recorded), such as gain=80V/m, integral_time=0.5s",
    text: "They hold from now to the end of this test, without a bump. What the model calls unstable is refused." }),
  abort: () => ({ title: "Abort the campaign", confirm: "Abort", danger: true, remark: "Remark (recorded)",
    text: "The motion comes to rest, the rig is made safe, the campaign ends. It can be gone on with later. The Stop button does the same without a question." }),
};
const ORDERS = { reset: "go on" };

for (const button of document.querySelectorAll("[data-do]")) {
  button.addEventListener("click", async () => {
    // What the station tells of is acknowledged to it: it keeps that in the journal of the run.
    const ended = button.dataset.do === "acknowledge" && !waitsToBeSeen(link) ? unseen() : undefined;
    const told = await ask(DIALOGS[button.dataset.do]());
    if (!told) return;
    const goesOn = button.dataset.do === "start" && told.name.startsWith(GO_ON);
    const chosen = goesOn ? told.name.slice(GO_ON.length) : ended ? ended.folder : told.name;
    if (button.dataset.do === "set") { await order("set", { name: shownRun() ?? "", text: told.text }); return; }
    const name = ended || ["start", "reset", "skip", "retry"].includes(button.dataset.do) ? { name: chosen } : {};
    const kind = goesOn ? "go on" : ORDERS[button.dataset.do] ?? button.dataset.do;
    await order(kind, { ...name, ...(told.text ? { text: told.text } : {}) });
  });
}

by("rig-last-seen").addEventListener("click", async () => {
  const runs = trippedRuns(link);
  if (!runs.length) { document.querySelector("[data-do=acknowledge]").click(); return; }
  const told = await ask(DIALOGS.acknowledge());
  for (const run of told ? runs : []) await order("acknowledge", { name: run.folder, ...(told.text ? { text: told.text } : {}) });
});

by("holder-button").addEventListener("click", async () => {
  const { holder } = link.common;
  if (!holder) return;
  if (isMine()) { await order("release"); return; }
  if (holder?.number === null) { await order("take"); return; }
  const away = holder.here ? "" : " Nobody watches under this name now.";
  const told = await ask({ title: `Take over from ${holder.name}`, confirm: "Take over", danger: true,
    text: `${holder.name} has had control since ${clock(holder.since_ms)}.${away} Everybody is told.` });
  if (told) await order("take over");
});

by("rig").addEventListener("change", (event) => link.choose(event.target.value));

// Before anything was heard, nothing can be asked for.
actions();
