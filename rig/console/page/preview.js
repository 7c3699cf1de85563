// What a start of a campaign would do, as `rig check` has it, before anything moves.

import { element, figure, lasted, shortly } from "./words.js";

const AGAIN_MS = 300; // the console itself waits some seconds before it says that a check goes on
const MM = 1000;

async function asked(campaign) {
  try {
    const response = await fetch(`/preview?${new URLSearchParams({ campaign })}`);
    return await response.json();
  } catch {
    return { problems: ["the console does not answer"] };
  }
}

const plain = (seconds) => `${Number(figure(seconds, 1))} s`;
const range = ([low, high], factor, digits) => `${figure(factor * low, digits)} to ${figure(factor * high, digits)}`;

function motion(test) {
  const speed = test.peak_speed_m_per_s === null ? "in jumps" : `at most ${figure(MM * test.peak_speed_m_per_s, 0)} mm/s`;
  const simulated = test.command_V === null ? "" : `${range(test.command_V, 1, 2)} V; simulated: `;
  return `${simulated}${range(test.position_m, MM, 0)} mm, ${speed} (valve: ${figure(MM * test.valve_speed_m_per_s, 0)} mm/s)`;
}

function shown(test, number) {
  const lines = [
    ["motion", motion(test)], ["expected", shortly(test.expect)],
    ...test.faults.map((text) => ["fault", text]), ...test.limits.map((text) => ["limit", text]),
    ...(test.following ? [["following", test.following.replace(/^following /, "")]] : []),
  ];
  return element("li", "", element("strong", "", `${number}. ${test.name}`), `, ${lasted(test.duration_s)}${test.settle_s ? ` after ${plain(test.settle_s)} of settling` : ""}`,
    element("dl", "figures", ...lines.flatMap(([name, text]) => [element("dt", "", name), element("dd", "", text)])),
    ...test.warnings.map((text) => element("p", "warn", `▲ ${text}`)));
}

// The greatest setpoints of all tests, which say how far and how fast the ram would go.
function greatest(tests) {
  const positions = tests.flatMap((test) => test.position_m);
  const speeds = tests.map((test) => test.peak_speed_m_per_s);
  const fastest = speeds.includes(null) ? "in jumps" : `at most ${figure(MM * Math.max(...speeds), 0)} mm/s`;
  return `${range([Math.min(...positions), Math.max(...positions)], MM, 0)} mm, ${fastest}`;
}

function folded(title, content) {
  return element("details", "", element("summary", "", title), content);
}

function plan(told) {
  const faults = told.tests.filter((test) => test.faults.length).length;
  const total = told.tests.reduce((sum, test) => sum + test.duration_s + test.settle_s, 0);
  const facts = [
    ["tests", `${told.tests.length}, ${faults ? `${faults} with` : "none with"} faults; ${lasted(total)} of rig time`], ["motion", greatest(told.tests)],
    ["limits", (told.rig.find((line) => line.startsWith("limits ")) ?? "").replace(/^limits /, "")],
  ];
  return [
    element("p", told.warnings.length ? "warn" : "good",
      told.warnings.length ? `▲ Valid, with ${told.warnings.length} ${told.warnings.length === 1 ? "warning" : "warnings"}` : "✓ Valid, without warnings"),
    ...told.warnings.map((text) => element("p", "warn", text)),
    ...told.summary.filter((line) => !line.startsWith("rig time ")).map((line) => element("p", "", line)),
    element("dl", "figures", ...facts.flatMap(([name, text]) => [element("dt", "", name), element("dd", "", text)])),
    element("ol", "plan", ...told.tests.map((test, k) => shown(test, k + 1))),
    folded("The rig and all its limits", element("ul", "", ...told.rig.map((line) => element("li", "", line)))),
    folded("All that rig check says", element("pre", "", told.text)),
  ];
}

// Shows a campaign's preview in a place, nothing for an empty name; a later call for the same place takes it over.
export async function preview(place, campaign) {
  place.dataset.campaign = campaign;
  if (!campaign) { place.replaceChildren(); return; } // a run that is gone on with was begun already
  place.replaceChildren(element("p", "quiet", `${campaign} is being checked.`));
  let found = { pending: true };
  while (found.pending && place.dataset.campaign === campaign && place.isConnected) {
    found = await asked(campaign);
    if (found.pending) await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
  }
  if (found.pending || place.dataset.campaign !== campaign) return;
  place.replaceChildren(...(found.plan ? plan(found.plan) : [
    element("p", "bad", "✕ It would not start:"), ...found.problems.map((text) => element("p", "bad", text))]));
}
