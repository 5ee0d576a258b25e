// The panel of parameters: bounds, units and defaults of each node's parameters, and setting them.

import { acting, element, refuse, say } from "./dom.js";
import { act, look } from "./session.js";

export async function showParams(panel, robot) {
  panel.replaceChildren(element("p", {}, "Asking the nodes …"));
  try {
    const { nodes } = await look(robot, "params");
    const filter = element("input", { id: "param-filter", type: "search" });
    const groups = nodes.map((node) => group(robot, node));
    filter.addEventListener("input", () => groups.forEach((found) => narrow(found, filter.value.trim().toLowerCase())));
    panel.replaceChildren(
      element("p", { className: "row" }, element("label", { for: "param-filter" }, "Find"), filter),
      ...(groups.length ? groups : [element("p", {}, "No node has parameters.")]),
      element("p", { className: "quiet" }, "A change takes effect between two ticks, and lasts until the robot goes down."));
  } catch (error) {
    panel.replaceChildren(element("p", {}, error.message));
  }
}

function narrow(found, text) {
  let isAny = false;
  for (const row of found.querySelectorAll(".param")) {
    row.hidden = !`${row.dataset.name}`.toLowerCase().includes(text);
    isAny ||= !row.hidden;
  }
  found.hidden = !isAny;
  if (text) found.open = isAny;
}

function group(robot, { node, params }) {
  return element("details", {}, element("summary", {}, node), ...params.map((param) => row(robot, node, param)));
}

let count = 0;

function row(robot, node, param) {
  const id = `param-${++count}`;
  const input = control(id, param);
  const state = element("span", { className: "quiet", id: `${id}-about` }, about(param));
  input.setAttribute("aria-describedby", state.id);
  const put = async (value) => {
    const answer = await act(robot, "param", { node, name: param.name, value });
    param.value = answer.values?.[param.name] ?? value;
    fill(input, param.value);
    say(`${param.name} is ${shown(param.value)}${param.unit ? ` ${param.unit}` : ""}.`);
    state.textContent = about(param);
  };
  const set = acting(element("button", { type: "submit", "aria-label": `Set ${param.name}` }, "Set"), async () => {
    if (!input.reportValidity()) throw new Error(`${param.name}: ${input.validationMessage}`);
    await put(taken(input, param));
  });
  const reset = acting(element("button", { type: "button", "aria-label": `Set ${param.name} to its default` }, "Default"), () => put(param.default));
  [set, reset].forEach((button) => refuse(button));
  reset.hidden = param.default === null || param.default === undefined;
  return element("form", { className: "param", noValidate: true, "data-name": `${node} ${param.name} ${param.meaning ?? ""}`, onsubmit: (event) => event.preventDefault() },
    element("label", { for: id }, param.name),
    element("div", { className: "row" }, input, element("span", { className: "unit" }, param.unit ?? ""), set, reset),
    state);
}

function control(id, param) {
  if (typeof param.value === "boolean") param.choices = ["true", "false"];
  if (param.choices?.length) {
    const made = element("select", { id }, ...param.choices.map((choice) => element("option", { value: String(choice) }, String(choice))));
    fill(made, param.value);
    return made;
  }
  const isNumber = typeof param.value === "number";
  const made = element("input", { id, type: isNumber ? "number" : "text", step: isNumber && Number.isInteger(param.value) && param.type === "integer" ? "1" : "any" });
  if (isNumber && Number.isFinite(param.min)) made.min = param.min;
  if (isNumber && Number.isFinite(param.max)) made.max = param.max;
  fill(made, param.value);
  return made;
}

const shown = (value) => (typeof value === "object" ? JSON.stringify(value) : String(value));
const fill = (input, value) => { input.value = shown(value); };

function taken(input, param) {
  if (typeof param.value === "number") return input.valueAsNumber;
  if (typeof param.value === "boolean") return input.value === "true";
  if (typeof param.value === "string") return input.value;
  try {
    return JSON.parse(input.value);
  } catch {
    throw new Error(`${param.name}: ${input.value} is not a value such as ${shown(param.value)}`);
  }
}

function about(param) {
  if (param.default === null || param.default === undefined) return param.meaning ?? "";
  const bounds = Number.isFinite(param.min) || Number.isFinite(param.max) ? `${param.min ?? "…"} to ${param.max ?? "…"}, ` : "";
  return `${param.meaning ? `${param.meaning} ` : ""}${bounds}default ${shown(param.default)}${shown(param.value) === shown(param.default) ? "" : ", changed"}`;
}
