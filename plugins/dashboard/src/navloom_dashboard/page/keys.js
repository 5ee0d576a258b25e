// Keys of the whole page. Space stops the robot wherever the focus is, except in a field that takes text.

import { byId, element } from "./dom.js";

const ROWS = [
  ["Space", "STOP, wherever the focus is, except in a field for text"],
  ["R", "resume"],
  ["M", "focus the map"],
  ["G", "goal: arrow keys move the cursor, Shift with arrow keys turns the heading, Enter places it, and Enter again drives there; further points before that are points on the way"],
  ["P", "I am here: as a goal"],
  ["Backspace", "on the map: remove the last point"],
  ["Escape", "close the tool, or the panels"],
  ["C", "cancel the goal"],
  ["L", "relocalise: search on the whole map"],
  ["T", "focus the stick: hold arrow keys, W A S D, Q or E to drive; letting go stops"],
  ["O", "panels; arrow keys choose one"],
  ["Arrow keys", "on the map without a tool: move it"],
  ["+ -", "zoom"],
  ["[ ]", "rotate the map"],
  ["F", "follow the robot"],
  ["0", "show the whole map"],
  ["?", "this list"],
];

const takesText = (target) =>
  target instanceof HTMLTextAreaElement || (target instanceof HTMLInputElement && ["text", "password", "search"].includes(target.type));
const takesLetters = (target) => takesText(target) || target instanceof HTMLInputElement || target instanceof HTMLSelectElement;

/**
 * @param stop Stops the robot.
 * @param actions Key, in lower case -> what it does.
 * @param isReady Whether the page shows a robot.
 */
export function listenKeys(stop, actions, isReady) {
  byId("help-keys").replaceChildren(...ROWS.flatMap(([keys, text]) => [
    element("dt", {}, ...keys.split(/(?<=\S) (?=\S)/).map((key) => element("kbd", {}, key))), element("dd", {}, text)]));
  let letters = localStorage.getItem("navloom-letters") !== "off";
  const button = byId("letters");
  const show = () => button.setAttribute("aria-pressed", String(letters));
  show();
  button.addEventListener("click", () => {
    letters = !letters;
    localStorage.setItem("navloom-letters", letters ? "on" : "off");
    show();
  });

  const isStop = (event) => event.key === " " && isReady() && !takesText(event.target);
  // In the capture phase, so that no part of the page can swallow it; a button would be clicked at keyup.
  window.addEventListener("keydown", (event) => {
    if (!isStop(event)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) stop();
  }, true);
  window.addEventListener("keyup", (event) => isStop(event) && event.preventDefault(), true);

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || !isReady()) return;
    if (byId("help").open) return;
    const isLetter = event.key.length === 1;
    if (isLetter && (!letters || takesLetters(event.target))) return;
    const action = actions[isLetter ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action(event);
  });
}
