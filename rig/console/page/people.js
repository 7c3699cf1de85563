// Who is logged in, by which role, and what that role may not do. Without accounts nothing is shown.

const by = (id) => document.getElementById(id);

// The page's words for orders that are called otherwise.
const ORDERS = { reset: "go on" };

// Shows name and role, and takes away what the server would refuse, with the reason under the cursor.
export function limit(link, isMine) {
  if (link.role === null) return;
  by("role").textContent = by("role").title = `${link.name}, ${link.role}`;
  for (const button of document.querySelectorAll("[data-do]")) {
    const name = button.dataset.do;
    forbid(button, link.mayNot[ORDERS[name] ?? name]);
    if (name === "set") button.hidden = link.role !== "engineer";
  }
  forbid(by("holder-button"), isMine ? "" : link.mayNot.take, true);
  if (link.mayNot.take) by("actions-why").textContent = "You see everything and may stop. Whoever acts needs the role operator.";
}

function forbid(button, why, enables = false) {
  if (why) button.disabled = true;
  else if (enables) button.disabled = false;
  button.title = why ? `Not possible: ${why}.` : "";
}

// What stands at the head of a page whose login has ended: it can still stop, and says so.
export const EXPIRED = ["warn", "Your login has expired",
  "The page shows nothing new any more. Stop (F9) still works here. Log in again to see and to act."];

// The way to the login; nothing else is offered but stop.
export function offerLogin() {
  for (const button of document.querySelectorAll("[data-do], #holder-button")) button.disabled = true;
  const button = by("log-in");
  button.hidden = false;
  button.onclick = () => location.assign("/login");
}
