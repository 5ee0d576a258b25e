// The panel that compares the instances of each role, and makes another one active.

import { acting, element, refuse, say } from "./dom.js";
import { act } from "./session.js";
import { Strip } from "./strip.js";

/** Time between two updates of the numbers, ms: faster ones cannot be read. */
const READABLE = 500;

export class Compare {
  constructor(panel, robot) {
    Object.assign(this, { panel, robot });
    this.strips = new Map();
    this.key = "";
    this.spoken = 0;
    panel.replaceChildren(element("p", {}, "No role to compare so far."));
  }

  /** Takes the commands of one tick. */
  take(commands) {
    for (const [role, entries] of Object.entries(commands.roles)) {
      if (!this.strips.has(role)) this.strips.set(role, new Strip(role));
      this.strips.get(role).add(entries);
    }
  }

  /** Builds the panel again when roles, instances or the active ones have changed. */
  show(robot, colours, isVisible) {
    const roles = robot?.roles ?? {};
    const key = JSON.stringify([Object.values(roles).map((nodes) => nodes.map(({ instance, active, fault }) => [instance, active, fault])), [...this.strips.keys()]]);
    if (key !== this.key) this._build(robot, roles);
    this.key = key;
    if (!isVisible) return;
    const now = performance.now();
    const isSpoken = now - this.spoken > READABLE;
    if (isSpoken) this.spoken = now;
    for (const strip of this.strips.values()) strip.show(colours, isSpoken);
  }

  _build(robot, roles) {
    const focused = document.activeElement?.dataset?.swap;
    const sections = Object.entries(roles).map(([role, nodes]) => element("section", { className: "role" },
      element("h3", {}, role),
      this.strips.get(role)?.element ?? null,
      element("ul", {}, ...nodes.map((node) => this._instance(role, node))),
      role === "platform" ? null : this._other(role, (robot.plugins?.[role] ?? []).filter((name) => !nodes.some(({ instance }) => instance === name)))));
    this.panel.replaceChildren(...(sections.length ? sections : [element("p", {}, "The robot has not said its roles so far.")]));
    if (focused) this.panel.querySelector(`[data-swap="${CSS.escape(focused)}"]`)?.focus();
  }

  _instance(role, { instance, active, fault }) {
    const about = fault ? ` – ${fault}` : "";
    if (active) return element("li", { className: "active" }, element("strong", {}, instance), ` active${about}`);
    const button = acting(element("button", { type: "button", "aria-label": `Make ${instance} active as ${role}`, "data-swap": `${role} ${instance}` }, "Make active"),
      () => this._swap(role, instance));
    refuse(button);
    return element("li", {}, element("span", {}, instance, about), button);
  }

  /** A plugin that the robot does not have yet: it starts in shadow first. */
  _other(role, names) {
    const id = `other-${role}`;
    const choice = element("input", { id, type: "text", autocomplete: "off", spellcheck: false });
    choice.setAttribute("list", `${id}-names`);
    const button = acting(element("button", { type: "button", "aria-label": `Start this ${role} and make it active` }, "Start"), () => this._swap(role, choice.value.trim()));
    refuse(button);
    return element("p", { className: "row" }, element("label", { for: id }, `Another ${role}`), choice,
      element("datalist", { id: `${id}-names` }, ...names.map((name) => element("option", { value: name }))), button);
  }

  async _swap(role, instance) {
    say(`Making ${instance} active as ${role} …`);
    await act(this.robot, "swap", { role, instance });
    say(`${instance} is active as ${role}.`);
  }
}
