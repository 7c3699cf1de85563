// Each section as it is shown: a function of its name is called when it has changed.

import { ofStation, shownUse, unseenUse } from "./uses.js";
import { capital, clock, element, figure, lasted, leak, shortly, tone, verdict } from "./words.js";


const by = (id) => document.getElementById(id);
const SHOWN_EVENTS = 80;
const UNHEARD = "not heard yet";

function put(target, made) {
  // Lists are shown anew only if they changed: a selection within them stays otherwise.
  const text = made.map((each) => each.outerHTML).join("");
  if (target.dataset.shown === text.length + ":" + text) return;
  target.dataset.shown = text.length + ":" + text;
  target.replaceChildren(...made);
}

function pairs(target, items) {
  const made = items.flatMap(([name, value, how]) => [
    element("dt", "", name), element("dd", how ?? "", value),
  ]);
  put(target, made);
}

const head = (...names) => element("thead", "", element("tr", "", ...names.map((name) => element("th", "", name))));

// Nothing of the rig that was shown stays on the page: its sections are drawn from nothing.
export function clear(charts) {
  for (const chart of Object.values(charts)) { chart.ends = null; chart.draw({ time_s: [], test: [] }); }
  for (const id of ["readings", "contacts", "first-out", "confirmed", "bypass", "loop", "stages", "parts", "tests", "verdicts", "events", "probabilities"]) {
    by(id).replaceChildren();
    delete by(id).dataset.shown;
  }
  for (const id of ["rig-name", "state", "action", "progress-text", "progress-time", "statistic-text"]) by(id).textContent = "";
  by("progress-bar").style.width = by("statistic-bar").style.width = "0";
  campaign({ sections: {} });
  judged({ sections: {} });
}

// ---- console ------------------------------------------------------------------------------------

export function rigs({ common, rig }) {
  const several = common.rigs.length > 1;
  by("rig-choice").hidden = !several;
  by("rig-name").hidden = several;
  by("rig").replaceChildren(...common.rigs.map((each) =>
    new Option(each.life === "live" ? each.rig : `${each.rig} (${each.life})`, each.rig, false, each.rig === rig)));
  by("rig-name").textContent = rig;
}

export function holder({ common, you }) {
  const { number, name, since_ms: since, here } = common.holder;
  const mine = number !== null && number === you;
  by("holder").textContent = number === null ? "nobody has control"
    : mine ? "you have control" : `${name} has control since ${clock(since)}${here ? "" : " (away)"}`;
  by("holder").title = by("holder").textContent;
  by("holder").className = mine ? "mine" : "";
  by("holder-button").textContent = mine ? "Give up" : number === null ? "Take control" : "Take over";
}

export function viewers({ common }) {
  const names = common.viewers.map((each) => each.name);
  by("viewers").textContent = names.length > 1 ? `${names.length} watch` : "";
  by("viewers").title = names.join(", ");
}

// ---- rig ----------------------------------------------------------------------------------------

export function life({ sections, rig }) {
  // What has tripped is not running any more, whatever its session has said last.
  by("state").textContent = sections.life.life !== "live" ? "" : hasTripped(sections) ? "tripped" : sections.life.state;
  by("rig-name").textContent = rig;
  loop(sections);
}

export function readings({ sections }) {
  pairs(by("readings"), sections.readings.map(({ name, value, unit }) => [name, `${value ?? "-"} ${unit}`]));
}

// What a meter reads while its valve is shut is its zero, and no leak.
function metered({ metered_L_per_min: flow, shut_L_per_min: shut }) {
  if (shut === null) return element("td", "number", figure(flow, 2));
  const cell = element("td", "number quiet", `(${figure(shut, 2)})`);
  cell.title = "The valve is shut: this is what the meter reads of nothing.";
  return cell;
}

export function bypass({ sections }) {
  const valves = sections.bypass;
  const none = sections.life?.is_read ? "This rig has none." : UNHEARD;
  const position = (part) => (part === null ? "-" : part >= 0.99 ? "open" : part <= 0.01 ? "shut" : "moves");
  put(by("bypass"), valves.length === 0 ? [element("caption", "quiet", none)] : [
    head("valve", "ball", "needle", "meter L/min"),
    element("tbody", "", ...valves.map((valve) => element("tr", "",
      element("td", "", shortly(valve.name)),
      element("td", valve.ball === null ? "" : `state ${valve.ball > 0.01 ? "live" : "off"}`, position(valve.ball)),
      element("td", "number", valve.needle === null ? "-" : `${figure(100 * valve.needle, 1)} %`),
      metered(valve)))),
  ]);
}

export function interlocks({ sections }) {
  const { contacts, sentence } = sections.interlocks;
  // A trip of what drove last stands here until somebody has seen it, as at the top.
  const { first_out: firstOut, confirmed } = unseenUse({ sections })?.interlocks ?? sections.interlocks;
  pairs(by("contacts"), contacts.map(({ name, text, how }) => [name, text, `state ${how}`]));
  by("action").className = sentence ? "warn" : "quiet";
  by("action").textContent = sentence ? capital(sentence) : firstOut.length ? ""
    : !sections.life?.is_read || contacts.length && sections.health?.rate_hz === null ? UNHEARD
    : contacts.length ? "no limit acts" : "A simulated rig has none.";
  put(by("first-out"), firstOut.map((trip, k) => element("li", "",
    element("strong", "", k === 0 ? "first out: " : `${figure(trip.after_ms, 0)} ms later: `),
    `${trip.by}, ${trip.sentence} (${trip.cause}). `, element("span", "quiet", `Remedy: ${trip.remedy}.`))));
  pairs(by("confirmed"), confirmed.map(({ step, after_ms: after }) =>
    [step, after === null ? "not confirmed" : `${figure(after, 0)} ms`, after === null ? "state bad" : "state good"]));
}

function loop(sections) {
  const told = sections.health ?? {};
  const rows = [["rate", `${figure(told.rate_hz, 0)} Hz`]];
  if (told.missed !== undefined) {
    rows.push(["ticks missed", `${told.missed ?? "-"}`, told.missed ? "warn" : ""]);
    rows.push(["exchanges failed", `${told.exchange_errors ?? "-"}`, told.exchange_errors ? "warn" : ""]);
  }
  const missing = Object.entries(sections.life?.missing ?? {});
  rows.push(["not arrived here", missing.length ? missing.map(([kind, n]) => `${n} ${kind}`).join(", ") : "0"]);
  if (sections.life?.restarts) rows.push(["stream begun anew", `${sections.life.restarts} times`]);
  pairs(by("loop"), rows);
}

export function health({ sections }) {
  loop(sections);
  const { stages_us: stages, silent_ms: silent } = sections.health;
  put(by("stages"), stages.length === 0 ? [] : [
    head("µs", "median", "99 %", "most"),
    element("tbody", "", ...stages.map((stage) => element("tr", "", element("td", "", stage.name),
      ...["p50", "p99", "max"].map((key) => element("td", "number", figure(stage[key], 0)))))),
  ]);
  pairs(by("parts"), Object.entries(silent).map(([part, ms]) =>
    [`${part} heard`, `${figure(ms, 0)} ms ago`, ms > 1500 ? "bad" : ""]));
}

export function progress({ sections }) {
  const told = sections.progress;
  by("progress-text").textContent = told.name ? `${told.number} of ${told.count}: ${told.name}` : "";
  by("progress-time").textContent = told.duration_s ? `${figure(told.time_s, 0)} of ${figure(told.duration_s, 0)} s` : "";
  const part = told.duration_s ? Math.min(told.time_s / told.duration_s, 1) : 0;
  by("progress-bar").style.width = `${100 * part}%`;
}

// Whether the rig that is heard has tripped; its run still writes what came of it.
export const hasTripped = ({ life, interlocks }) =>
  life?.life === "live" && (life.state === "tripped" || (interlocks?.first_out?.length ?? 0) > 0);

// What is known of a rig that is not heard any more is what was.
function now(sections, status) {
  if (status !== "running") return status;
  return hasTripped(sections) ? "tripped" : sections.life?.life === "dead" ? "was running" : status;
}

// How somebody has seen how what drove the rig last has ended.
function seen({ acknowledged }) {
  return acknowledged?.by ? `acknowledged by ${acknowledged.by} at ${clock(acknowledged.at_ms)}${acknowledged.text ? `: ${acknowledged.text}` : ""}` : "";
}

export function campaign({ sections }) {
  const use = shownUse({ sections });
  const told = use.campaign ?? {};
  // What a station does that only reads stands at the top, and is no campaign.
  if (ofStation(told)) {
    by("campaign-title").textContent = "Campaign";
    by("campaign-name").textContent = "None runs";
    by("campaign-more").textContent = "";
    return;
  }
  by("campaign-title").textContent = use === sections ? told.activity ? "In use" : "Campaign" : "Last use of the rig";
  const runs = (told.tests ?? []).some((test) => test.status === "running");
  const status = told.status === "running" && !runs && (told.pausing || told.held?.length) ? "held" : told.status;
  by("campaign-name").textContent = told.name ? `${told.name}, ${now(sections, status)}` : "none";
  by("campaign-more").textContent = told.name
    ? [told.activity !== told.name && told.activity,
      told.model && `rig ${told.rig}, model ${told.model}, filter ${told.filter}`,
      `${told.resumed ? "gone on with" : "begun"} ${clock(told.begun_ms)}${told.begun_by ? ` by ${told.begun_by}` : ""}${told.rig_time_s ? `, ${lasted(told.rig_time_s)} of rig time` : ""}`,
      seen(use)].filter(Boolean).join("; ") : "";
}

export function launch({ common }) {
  const { last } = common.launch;
  if (last?.ending) by("campaign-card").dataset.ending = last.ending;
}

export function queue({ sections }) {
  const use = shownUse({ sections });
  const { campaign: told } = use;
  const progress = use === sections ? sections.progress : null;
  if (!told?.tests) { put(by("tests"), []); return; }
  const running = told.status === "running" ? progress?.name : null;
  put(by("tests"), [
    head("", "test", "expected", "found", ""),
    element("tbody", "", ...told.tests.map((test, k) => {
      const runs = test.name === running && (!test.status || test.status === "running" || progress.time_s < progress.duration_s);
      const status = runs ? "running" : test.status || (told.status === "running" ? "waits" : "not run");
      return element("tr", runs ? "runs" : "",
        element("td", "number quiet", `${k + 1}`), element("td", "", test.name),
        element("td", "", shortly(test.expect)), element("td", "", runs ? "" : test.verdict ? shortly(test.verdict) : ""),
        element("td", `status ${status.replaceAll(" ", "-")}`, now(sections, status)));
    })),
  ]);
}

// ---- verdicts and events ------------------------------------------------------------------------

export function judged({ sections }) {
  const use = shownUse({ sections });
  const told = use.decision;
  const name = told?.verdict ?? "";
  const chance = told?.probabilities?.[name];
  by("verdict").textContent = name ? verdict(name) : "None yet";
  const { campaign: shown } = use;
  const present = use === sections ? sections.progress : null;
  // What a detector has said last stands until it judges the next test, beside what was expected of its own.
  const of = told?.test || present?.name;
  const expected = (shown?.tests ?? []).find((test) => test.name === of)?.expect || (of === present?.name ? present?.expect : "");
  const ended = shown?.status === "ended";
  const isOver = ended || Boolean(present?.name) && of !== present.name;
  const unclear = ended && (shown.tests ?? []).some((test) => test.status !== "passed");
  by("verdict-title").textContent = isOver && name ? `Last verdict, of ${of}` : "Verdict";
  // What a detector held last is no good news of a campaign that did not come out well.
  by("verdict").className = name && name === expected && tone(name) === "fault" ? "found"
    : unclear && tone(name) === "good" ? "open" : tone(name);
  const parts = [];
  if (chance !== undefined && chance !== null) parts.push(chance > 0.999 ? "over 99.9 %" : `${figure(100 * chance, 1)} %`);
  if (told?.suspected) parts.push(`suspected: ${verdict(told.suspected)}`);
  if (told?.leak_L_per_min && leak(told.leak_L_per_min)) parts.push(leak(told.leak_L_per_min));
  if (told?.onset_s !== null && told?.onset_s !== undefined) parts.push(`since ${figure(told.onset_s, 1)} s of the test`);
  if (told?.growth) parts.push(told.growth);
  if (told?.duty) parts.push(`comes and goes, open ${figure(100 * told.duty, 0)} % of the time`);
  if (told?.ended_s !== null && told?.ended_s !== undefined) {
    parts.push(`${told.duty ? "last open until" : "gone again at"} ${figure(told.ended_s, 1)} s`);
  }
  if (expected) parts.push(name === expected ? "as expected" : `expected${isOver ? "" : " at the end"}: ${verdict(expected).toLowerCase()}`);
  by("verdict-more").textContent = parts.join("; ");
  by("statistic").hidden = told?.statistic === undefined || told?.statistic === null;
  if (!by("statistic").hidden) {
    by("statistic-text").textContent = `${figure(told.statistic, 1)}, threshold ${figure(told.threshold, 1)}`;
    // The mark of the threshold stands in the middle.
    const part = told.threshold ? told.statistic / told.threshold / 2 : 0;
    by("statistic-bar").style.width = `${100 * Math.min(part, 1)}%`;
    by("statistic-bar").className = part >= 0.5 ? "over" : "";
  }
  const likely = Object.entries(told?.probabilities ?? {}).filter(([, p]) => p > 0.0005)
    .sort((one, other) => other[1] - one[1]).slice(0, 3);
  pairs(by("probabilities"), likely.length < 2 ? [] : likely.map(([fault, p]) => [verdict(fault), `${figure(100 * p, 1)} %`]));
}

export function verdicts({ sections }) {
  const rows = [...sections.verdicts].reverse();
  put(by("verdicts"), [
    head("", "test", "at", "verdict", "leak"),
    element("tbody", "", ...rows.map((each) => element("tr", "",
      element("td", "quiet", clock(each.at_ms)), element("td", "", each.test),
      element("td", "number", `${figure(each.time_s, 1)} s`),
      element("td", tone(each.verdict), shortly(each.verdict)),
      element("td", "number wraps", leak(each.leak_L_per_min))))),
  ]);
}

export function happened({ sections, common }) {
  const own = (common.notices ?? []).map((notice) => ({ ...notice, who: "console", kind: "told" }));
  const rows = [...(sections.events ?? []), ...own].sort((one, other) => other.at_ms - one.at_ms);
  const grave = new Set(["trip", "error", "refused"]);
  put(by("events"), [
    element("tbody", "", ...rows.slice(0, SHOWN_EVENTS).map((event) => element("tr", grave.has(event.kind) ? "grave" : "",
      element("td", "quiet", clock(event.at_ms)), element("td", "", event.kind.replaceAll("_", " ")),
      element("td", "", event.text)))),
  ]);
}
