// One dialog at a time asks before something is done. The stop button stays within reach: the
// dialog is not modal by the browser's own means, which would make everything else inert.

const dialog = document.getElementById("dialog");
const shade = document.getElementById("shade");
const form = dialog.querySelector("form");
const choice = document.getElementById("dialog-choice");
const remark = document.getElementById("dialog-remark");
const details = document.getElementById("dialog-details");
const confirm = form.querySelector('[value="confirm"]');
const cancel = form.querySelector('[value="cancel"]');
let settle = null;
let before = null;

function end(result) {
  if (!settle) return;
  dialog.close();
  delete details.dataset.campaign;
  shade.hidden = true;
  document.querySelector("main").inert = false;
  const done = settle;
  settle = null;
  before?.focus();
  done(result);
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  end({ name: choice.querySelector("select").value, text: remark.querySelector("input").value.trim() });
});
cancel.addEventListener("click", () => end(null));
shade.addEventListener("click", () => end(null));
// In a list of choices Enter does nothing by itself; here it confirms, as everywhere in a dialog.
choice.addEventListener("keydown", (event) => {
  if (event.key === "Enter") { event.preventDefault(); form.requestSubmit(); }
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape" && settle) { event.preventDefault(); end(null); }
});

// Asks; gives {name, text}, or null if it is not to be done.
// told: title, text, confirm, danger, choice: {label, options: [[value, text]]}, remark, needed, isWide;
// shown: a function that fills a place below the text, which is told the choice, also when that changes.
export function ask(told) {
  end(null);
  before = document.activeElement;
  document.getElementById("dialog-title").textContent = told.title;
  document.getElementById("dialog-text").textContent = told.text ?? "";
  const select = choice.querySelector("select");
  choice.hidden = !told.choice;
  select.replaceChildren(...(told.choice?.options ?? []).map(([value, text]) => new Option(text, value)));
  if (told.choice) choice.querySelector("span").textContent = told.choice.label;
  const input = remark.querySelector("input");
  remark.hidden = !told.remark;
  remark.querySelector("span").textContent = told.remark ?? "";
  input.value = "";
  input.required = Boolean(told.needed);
  dialog.classList.toggle("wide", Boolean(told.isWide));
  details.hidden = !told.shown;
  details.replaceChildren();
  delete details.dataset.campaign;
  select.onchange = told.shown ? () => told.shown(details, select.value) : null;
  confirm.textContent = told.confirm;
  confirm.classList.toggle("danger", Boolean(told.danger));
  shade.hidden = false;
  document.querySelector("main").inert = true;
  dialog.show();
  told.shown?.(details, select.value);
  (told.choice ? select : told.remark ? input : confirm).focus();
  return new Promise((resolve) => { settle = resolve; });
}
