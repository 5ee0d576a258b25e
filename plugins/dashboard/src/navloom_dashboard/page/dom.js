// Elements of the page. Text from a robot becomes text, never markup: nothing here or elsewhere sets innerHTML.

export const byId = (id) => document.getElementById(id);

/** A new element; `properties` are set on it, `on…` are listeners, `aria-…` and `data-…` attributes. */
export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name.includes("-") || name === "role" || name === "for") made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return made;
}

/** Sets the text of an element if it differs, so that a screen reader is not told twice. */
export function write(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

/** Commands that remedies name -> what does the same on this page. */
const HERE = {
  stop: "STOP", resume: "Resume", goal: "Goal", cancel: "Cancel goal", place: "I am here", relocalise: "Relocalise",
  teleop: "Panels, Drive", swap: "Panels, Compare", params: "Panels, Parameters", doctor: "Panels, Events", record: "Panels, Record",
};

/** Text with the commands between backticks as code, or as what does the same on this page. */
export function withCode(text) {
  return String(text ?? "").split("`").map((part, i) => {
    if (i % 2 === 0) return part;
    const here = HERE[/^navloom (\w+)/.exec(part)?.[1]];
    return here ? element("b", { className: "here" }, here) : element("code", {}, part);
  });
}

let saying = 0;

/** Shows a sentence for some seconds, and a screen reader reads it. */
export function say(text, isBad = false) {
  const said = byId("said");
  said.textContent = text;
  said.classList.toggle("bad", isBad);
  said.classList.add("shown");
  clearTimeout(saying);
  saying = setTimeout(() => said.classList.remove("shown"), isBad ? 9000 : 4000);
}

const guarded = new Map();

/** Makes a button that acts: where it may not, it stays in the order of focus and says why. */
export function acting(button, act) {
  guarded.set(button, "");
  button.addEventListener("click", async () => {
    const reason = guarded.get(button);
    if (reason) return say(reason, true);
    try {
      await act();
    } catch (error) {
      say(error.message, true);
    }
  });
  return button;
}

let everywhere = "";

/** Why no act is possible now, such as the right of a viewer; empty if they are. */
export function refuseActs(reason) {
  everywhere = reason;
  for (const button of guarded.keys()) {
    if (button.isConnected) refuse(button, reason);
    else guarded.delete(button);
  }
}

export function refuse(button, reason = everywhere) {
  guarded.set(button, reason);
  button.setAttribute("aria-disabled", String(Boolean(reason)));
  button.title = reason;
}

/** A reason that holds for an act, or the empty text. */
export const refusal = () => everywhere;

export const fixed = (value, digits = 2) => (Number.isFinite(value) ? (Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value).toFixed(digits) : "–");
export const degrees = (angle) => (Number.isFinite(angle) ? `${Math.round((angle * 180) / Math.PI)}°` : "–");
export const seconds = (age) => (!Number.isFinite(age) ? "–" : age < 10 ? `${age.toFixed(1)} s` : age < 120 ? `${Math.round(age)} s` : `${Math.round(age / 60)} min`);
