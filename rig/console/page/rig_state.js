// How the rig stands, in a word and a sentence: what the page says first, and says only once.

import { byHand, capital, clock, lasted } from "./words.js";
import { isOfAnother, ofStation, shownUse, trippedRuns, underWay, unseenTrips, unseenUse } from "./uses.js";

const STARTING = {
  __proto__: null,
  connecting: ["Connecting", "Devices are opened and verified; nothing moves yet."],
  disarmed: ["Disarmed", "Connected; the valve is at null and disabled."],
  arming: ["Arming", "The pump is loaded; then press reset at the rig, while its lamp is lit."],
  "not homed": ["Not homed", "The valve is enabled; the ram rests until it is homed."],
  homing: ["Homing", "The ram moves slowly; where it is, is not known before it has met its stroke end."],
  off: ["Disarmed", "The rig is left, and its devices are closed."],
  "ramping down": ["Coming to rest", "The motion is brought to rest, then the valve is disabled."],
};

// A count of seconds goes on in such steps: whoever does not see the page is read each of them aloud.
const COUNTED_S = 5;

// For how long something has gone on since a time of the console's clock; "" before the first step.
function since(link, ms) {
  const counted = COUNTED_S * Math.floor((Date.now() - link.aheadMs - ms) / 1000 / COUNTED_S);
  return ms && counted > 0 ? ` for ${counted < 10 ? `${counted} s` : lasted(counted)}` : "";
}

// That the rig's programs are compiled before its devices are open, and for how long; "" if they are not.
function compiling(link) {
  const { compiles, compiles_since_ms: begun } = link.sections.life;
  const lasts = since(link, begun);
  return compiles ? `Its program is compiled for this machine, once for each version of it; begun at ${clock(begun)}${lasts && `, on its way${lasts}`}.` : "";
}

function readSoon(link) {
  const compiles = compiling(link);
  return ["off", "Idle", compiles ? `${compiles} Nothing drives.` : "The station opens the devices; nothing drives."];
}

// Why the valve is disabled, other than that the devices are open and nothing has moved yet; "" if that is so.
function whyDisarmed({ state, before }, campaign) {
  const was = before && before !== "connecting";
  if (state !== "disarmed" || !was) return "";
  return campaign.activity === "manual" ? "The valve is at null and disabled." : "The rig is left: the valve is at null and disabled.";
}

// The states of a session in words; the first motions of a new rig are not homing, though its encoder has no zero meanwhile either.
const startingWords = ({ state }, { activity }) => (state === "homing" && activity?.includes("first motions")
  ? ["First motions", "The ram makes small moves, to find which way it goes; where it is, is not known yet."] : STARTING[state]);

const several = (tests) => tests.map((test) => test.name).join(", ");
const sentence = (text) => (text && !/[.!?]$/.test(text) ? `${text}.` : text ?? "");
const trip = ({ sentence: what, remedy, by, cause }) => `${sentence(what)} Remedy: ${sentence(remedy)} First out: ${by}, ${cause}.`;
const of = (tests, ...statuses) => tests.filter((test) => statuses.includes(test.status));

// What waits before the next test: an operator's pause, or conditions that are not met.
const waits = ({ pausing, held } = {}) => Boolean(pausing) || (held?.length ?? 0) > 0;

// The steps to the safe state that no device has confirmed since a trip, in words of what to do; "" if there are none.
function unconfirmed({ confirmed } = {}, isOver) {
  const open = (confirmed ?? []).filter((step) => step.after_ms === null).map((step) => step.step);
  if (!open.length) return "";
  return isOver ? `NOT CONFIRMED SAFE: ${open.join(", ")}. Keep away from the ram, press the emergency stop at the rig, and look at its valves and pump there.`
    : `Not confirmed yet: ${open.join(", ")}. Keep away from the ram; if this does not go within 5 s, press the emergency stop at the rig.`;
}
function tripped(interlocks, isOver) {
  const [what, open] = [trip(interlocks.first_out[0]), unconfirmed(interlocks, isOver)];
  return open ? `${open} ${capital(what)}` : what;
}

// Where a campaign stands while none of its tests runs, and how many of them are done.
function between(tests) {
  const done = tests.filter((test) => test.status && test.status !== "not_run").length;
  const place = !done ? "before the first test" : done < tests.length ? "between tests" : "after the last test";
  return [place, `${done} of ${tests.length} ${tests.length === 1 ? "test" : "tests"} done`];
}

// What the ram does under somebody's hand, as far as the state of its session tells.
function does({ activity, motion }, { state }) {
  if (activity !== "manual") return "";
  return { armed: ": the ram is at rest", running: `: the ram moves${motion ? ` (${byHand(motion)})` : ""}` }[state] ?? "";
}

// Who began what is under way.
const begunBy = (campaign) => (campaign?.begun_by ? ` Begun by ${campaign.begun_by}.` : "");

// The rig is left by its station, and not read yet by who has asked for it. After so many seconds that one has failed to connect.
const LONGEST_HANDOVER_S = 60;
const handsOver = (campaign) => ["warn", "Changing hands", `The station leaves the rig to ${sentence(campaign.hands_over)} Until that is heard, nobody reads the rig.`];

// A run that was started here, has ended badly, and never came to be the one that is shown.
function failedStart({ common, sections }) {
  const last = common.launch?.last;
  const { campaign } = shownUse({ sections });
  // One that went on in the folder of the run that is shown has begun anew, unless it failed before.
  if (!last?.exit_code) return null;
  return !last.heard && last.started_ms >= (campaign?.begun_ms ?? 0) ? last : null;
}

function ended({ life, campaign, interlocks }) {
  const tests = campaign.tests ?? [];
  const failed = of(tests, "failed", "error");
  const count = `${failed.length} of ${tests.length} ${tests.length === 1 ? "test" : "tests"}`;
  const first = interlocks?.first_out?.[0];
  const stopped = of(tests, "tripped")[0];
  if (campaign.hands_over && !first && !(life.age_s > LONGEST_HANDOVER_S)) return handsOver(campaign);
  if (ofStation(campaign) && !first && campaign.exit_code) return ["warn", "Idle", `The station cannot read the rig: ${sentence(campaign.reason)}`];
  if (ofStation(campaign) && !first && campaign.reason) return ["off", "Idle", sentence(capital(campaign.reason))];
  if (ofStation(campaign) && !first) return ["off", "Idle", "The station has left the rig: it has ended, lends the rig, or lost a device."];
  if (campaign.activity && !first && !stopped) {
    if (campaign.exit_code === null && campaign.reason) return ["warn", "Ended", sentence(campaign.reason)];
    return campaign.exit_code ? ["warn", "Stopped", `${capital(campaign.activity)} ended early: ${sentence(campaign.reason)}`]
      : ["good", "Ended", `${capital(campaign.activity)} came to its end.${begunBy(campaign)}`];
  }
  const begun = tests.some((test) => test.status && test.status !== "not_run");
  const refused = campaign.exit_code === 2 || (campaign.exit_code === 3 && campaign.reason?.startsWith("the rig: "));
  const also = failed.length ? ` ${count} failed: ${several(failed)}.` : "";
  if (first) return ["bad", "Tripped", tripped(interlocks, true) + also];
  if (stopped) return ["bad", "Tripped", sentence(stopped.message) + also];
  if (!begun && refused) return ["bad", "Not started", sentence(campaign.reason)];
  const incomplete = tests.filter((test) => !test.status || ["aborted", "interrupted", "not_run", "running"].includes(test.status));
  if (incomplete.length || campaign.exit_code === 3) {
    const left = incomplete.length ? `${incomplete.length} of ${tests.length} tests did not come to their end.` : "";
    return ["warn", "Stopped", `${campaign.reason ? `By ${sentence(campaign.reason)} ` : ""}${left}${also}`];
  }
  if (failed.length) return ["bad", `Ended, ${count} failed`, `Failed: ${several(failed)}.`];
  const skipped = of(tests, "skipped");
  if (skipped.length) return ["warn", `Ended, ${skipped.length} skipped`, `${several(skipped)}; all others passed.`];
  return ["good", "Ended, all passed", tests.length === 1 ? "Its one test came out as expected." : `${tests.length} tests came out as expected.`];
}

function live(link) {
  const { life, campaign, progress, interlocks } = link.sections;
  const first = interlocks?.first_out?.[0];
  if (first) return ["bad", "Tripped", tripped(interlocks, false)];
  if (life.state === "tripped") return ["bad", "Tripped", "The rig is being made safe."];
  if (campaign?.status === "idle" && campaign.hands_over) return handsOver(campaign);
  if (campaign?.status === "idle" && (life.state === "connecting" || life.compiles)) return readSoon(link);
  if (campaign?.status === "idle" && life.state === "off") return ["off", "Idle", "The station leaves the rig; nothing drives."];
  if (campaign?.status === "idle") return ["off", "Idle", "The station reads the rig; nothing drives."];
  // What has said that it has ended is heard for another moment.
  if (campaign?.status === "ended") return ended({ life, campaign, interlocks });
  if (campaign?.status !== "running") return ["off", "Idle", "No campaign runs on this rig."];
  const tests = campaign.tests ?? [];
  const failed = of(tests, "failed", "error");
  const also = failed.length ? ` Failed so far: ${several(failed)}.` : "";
  const runs = of(tests, "running")[0];
  if (life.state === "holding") return ["bad", "Held by the interlock", sentence(interlocks?.sentence)];
  if (STARTING[life.state]) {
    const [word, opens] = startingWords(life, campaign);
    const what = whyDisarmed(life, campaign) || (life.state === "connecting" && compiling(link)) || opens;
    return ["warn", word, `${what}${campaign.activity && campaign.activity !== life.state ? ` ${capital(campaign.activity)}.` : ""}${begunBy(campaign)}`];
  }
  if (campaign.activity && !runs) return ["live", "In use", `${capital(campaign.activity)}${does(campaign, life)}.${begunBy(campaign)}`];
  const [place, count] = between(tests);
  if (!runs && waits(campaign)) {
    const why = campaign.held.length ? `${campaign.held.map(sentence).join(" ")}` : `${campaign.paused_by || "An operator"} has asked for it; Resume goes on.`;
    return ["warn", "Held", `The ram is held ${place}; ${count}. ${why}${also}`];
  }
  if (!runs) return ["live", capital(place), `${campaign.name}: ${count}.${also}${begunBy(campaign)}`];
  const where = `${progress?.number ?? "-"} of ${progress?.count ?? tests.length}: ${sentence(runs.name)}`;
  if (campaign.pausing) return ["warn", "Running, to be held", `Test ${where} The ram is held after it${campaign.paused_by && `, as ${campaign.paused_by} has asked`}; Resume takes that back.${also}${begunBy(campaign)}`];
  if (campaign.activity) return ["live", "Running", `${capital(campaign.activity)}: motion ${where}${begunBy(campaign)}`];
  return [failed.length ? "warn" : "live", "Running", `Test ${where}${also}${begunBy(campaign)}`];
}

// Who has acknowledged how a run ended, and when.
function acknowledged({ common }, folder) {
  const seen = (common.launch?.seen ?? []).find((run) => run.folder === folder);
  return seen ? ` Acknowledged by ${seen.by} at ${clock(Date.parse(seen.at))}${seen.text ? `: ${sentence(seen.text)}` : "."}` : "";
}

// A run that was begun here, of this rig or of one that is not known, and that is not heard yet; or null.
function starting(link, run) {
  const { sections, common, rig } = link;
  const { campaign, life } = sections;
  // One that is heard is shown by what its rig says, and has said that it ended while it writes its report.
  if (!run || run.heard || life && run.folder === campaign?.directory && campaign.begun_ms >= run.started_ms) return null;
  if (life?.life === "live" && isOfAnother({ common, rig }, run)) return null;
  if (run.stopped) return ["warn", `Stopping ${run.name}`, `It was stopped by ${sentence(run.stopped)} Nothing has moved yet; its program ends.`];
  const lasts = since(link, run.started_ms);
  return ["warn", `${run.resumed ? "Going on with" : "Starting"} ${run.name}`, run.said ? `${sentence(run.said)}${lasts && ` On its way${lasts}.`}`
    : `Its program is loaded, which takes seconds, longer on a busy machine; its rig is not heard yet.${lasts && ` That has gone on${lasts}.`}`];
}

// What has tripped before, was driven again since, and is to be acknowledged still.
const trippedBefore = (link) => unseenTrips(link).map(({ name, activity, begun_by: by, ended_ms: at, sentence: what }) =>
  `${activity ? capital(activity) : name}${by ? `, begun by ${by},` : ""} tripped${at ? ` at ${clock(at)}` : ""}: ${sentence(what)}`).join(" ");

// The same without a station, by the journals of runs.
function trippedEarlier(link) {
  const [newest, ...older] = trippedRuns(link);
  if (!newest) return null;
  const also = older.length ? ` So did ${older.length} before ${older.length === 1 ? "it" : "that"}.` : "";
  return ["warn", "Tripped before", `${newest.campaign} (${newest.folder}) tripped${newest.at ? ` at ${clock(Date.parse(newest.at))}` : ""}.${also} Nobody has acknowledged that.`];
}

// Tone, word and sentence of how what drove the rig last has ended, beside the state of a station that reads it; null if
// somebody has seen it, or there is nothing to be seen.
export function lastState(link) {
  const failed = ofStation(link.sections.campaign) && link.sections.life?.life === "live" && !underWay(link) ? failedStart(link) : null;
  if (failed) return ["bad", `${failed.name} did not start`, sentence(failed.reason || failed.ending)];
  const use = unseenUse(link);
  const before = trippedBefore(link);
  if (!use && !before) return trippedEarlier(link);
  if (!use) return ["warn", "Tripped before", `${before} Nobody has acknowledged that${ofStation(link.sections.campaign) ? "." : "; it can be, once the rig is idle."}`];
  const also = before && ` Before that, and not acknowledged: ${before}`;
  const [own, word, why] = ended({ life: {}, campaign: use.campaign, interlocks: use.interlocks });
  // What still waits to be acknowledged is not good, however what came after it has ended.
  const tone = before && own === "good" ? "warn" : own;
  const { name, activity, begun_by: by } = use.campaign;
  // A campaign is called as it is written; what else is done with a rig begins a sentence.
  const what = `${activity ? capital(activity) : name}${by ? `, begun by ${by},` : ""}`;
  const at = use.ended_ms ? ` at ${clock(use.ended_ms)}` : "";
  const plain = why.replace(` Begun by ${by}.`, "");
  const way = ["came to its end", "ended early"].find((each) => activity && plain.startsWith(`${capital(activity)} ${each}`));
  if (way) return [tone, word, `${what} ${way}${at}${plain.slice(activity.length + 1 + way.length)}${also}`];
  const whose = plain.startsWith("By ") ? ` by ${plain.slice(3)}` : `. ${capital(plain)}`;
  return [tone, word, `${what} ended${at}${whose}${also}`];
}

// Returns tone, word and sentence.
export function rigState(link, lost, silent) {
  const { sections, common } = link;
  const { life, campaign } = sections;
  // A console that was started again has told nothing yet.
  if (!lost && !common.rigs || lost && !link.heardAt) return ["off", "Connecting", "The console is being asked."];
  if (lost) return ["bad", "The console does not answer", `for ${lasted(silent / 1000)}. What is shown is what was; stop the rig at the rig.`];
  const run = underWay(link);
  if (common.listening && !campaign?.name && !run) return ["off", "Listening", "The console has only begun to listen; what runs is heard within seconds."];
  const starts = starting(link, run);
  // What moves a rig, or has moved another one, stands before what was begun here and is not heard yet.
  if (life?.life === "live" && !(starts && ofStation(campaign) && !campaign.hands_over)) return live(link);
  if (starts) return ofStation(campaign) && campaign.hands_over && !(life?.age_s > LONGEST_HANDOVER_S) ? handsOver(campaign) : starts;
  const failed = failedStart(link);
  if (failed) return ["bad", `${failed.name} did not start`, sentence(failed.reason || failed.ending) + acknowledged(link, failed.folder)];
  if (life?.life === "dead") {
    const first = sections.interlocks?.first_out?.[0];
    return ["bad", "The stream is dead", `for ${lasted(life.age_s)}. What is shown is what was.${first ? ` It had tripped: ${tripped(sections.interlocks, true)}` : ""}`];
  }
  if (campaign?.status === "running" && life?.life === "unheard") return ["warn", ...STARTING.connecting];
  if (campaign?.status === "idle" && life?.life === "unheard") return readSoon(link);
  if (campaign?.name && life) {
    const [tone, word, why] = ended(sections);
    return [tone, word, why + acknowledged(link, campaign.directory)];
  }
  if (life && life.life !== "unheard") return ["off", "Idle", "No campaign runs on this rig."];
  return ["off", "No rig is heard", common.launch?.allowed ? "None runs yet. Whoever has control can start a campaign." : "None runs on this stream yet."];
}
