// How things are called on the page, and how numbers and times are written.

// Without a prototype: a verdict that is called "constructor" is a name like any other.
const VERDICTS = {
  __proto__: null,
  healthy: "Healthy",
  external_leakage_1: "External leakage, chamber 1",
  external_leakage_2: "External leakage, chamber 2",
  internal_leakage: "Internal leakage",
  supply_leakage: "Supply leakage",
  return_blockage: "Return blockage",
  multiple: "Several faults",
  unknown_fault: "Unknown fault",
  encoder_drift: "Encoder drifts",
  inconclusive: "Inconclusive",
};

const SHORT = {
  __proto__: null,
  external_leakage_1: "External leak 1",
  external_leakage_2: "External leak 2",
  internal_leakage: "Internal leak",
  supply_leakage: "Supply leak",
};

export const verdict = (name) => (name ? VERDICTS[name] ?? name.replaceAll("_", " ") : "-");

export const capital = (text) => `${text.slice(0, 1).toUpperCase()}${text.slice(1)}`;

// For tables.
export const shortly = (name) => SHORT[name] ?? verdict(name);

// good, fault or open: by which colour a verdict is shown.
export function tone(name) {
  if (name === "healthy") return "good";
  return !name || name === "inconclusive" ? "open" : "fault";
}

// A motion by hand as the page calls it; it comes as it is typed in a terminal.
export const byHand = (motion) => motion.replace(/^by /, "jog by ").replace(/^to /, "move to ").replace(/^generator /, "wave, ").replace(/^hold /, "hold: ");

export const figure = (value, digits) =>
  value === null || value === undefined ? "-" : Number(value).toFixed(digits);

export function leak([flow, low, high]) {
  if (flow === null || flow === undefined) return "";
  const interval = low === null || low === undefined ? "" : ` (${figure(low, 2)} to ${figure(high, 2)})`;
  return `${figure(flow, 2)}${interval} L/min`;
}

const CLOCK = new Intl.DateTimeFormat("en-GB", { timeStyle: "medium" });
export const clock = (ms) => (ms ? CLOCK.format(ms) : "");

export function lasted(seconds) {
  if (seconds === null || seconds === undefined) return "-";
  if (seconds < 120) return `${figure(seconds, seconds < 10 ? 1 : 0)} s`;
  if (seconds < 7200) return `${Math.round(seconds / 60)} min`;
  return `${(seconds / 3600).toFixed(1)} h`;
}

// Makes an element of a tag, with a class, holding texts or elements; nothing is ever parsed as HTML.
export function element(tag, className, ...held) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.append(...held.map((item) => item ?? ""));
  return made;
}

const MINE = "you have it, of this console; if the rig has another console, that one has a control of its own";
// What an order is called where it is answered, and what is said when it was done.
const ORDERS = {
  __proto__: null,
  start: ["Start", "is on its way; its state stands at the top"],
  "go on": ["Go on", "is on its way; its state stands at the top"],
  take: ["Control", MINE],
  "take over": ["Control", MINE],
  release: ["Control", "nobody has it"],
  set: ["Set control", "obeyed"],
  "queue add": ["Queue", "added at its end"],
  "queue move": ["Queue", "moved"],
  "queue remove": ["Queue", "removed"],
  "queue start": ["Queue", "started"],
  "queue halt": ["Queue", "halted; what runs goes on"],
};

// How an order was answered, in a sentence; `reason` is why it was not obeyed, empty if it was.
export function answered(order, reason) {
  const [name, done] = ORDERS[order] ?? [capital(order), "obeyed"];
  return `${name}: ${reason || done}`;
}
