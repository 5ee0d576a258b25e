// The panels: a list of tabs of which one is open, by pointer or by arrow keys.

import { byId } from "./dom.js";

export class Tabs {
  /** @param opened Called with the name of the panel that was opened. */
  constructor(opened) {
    this._opened = opened;
    this._tabs = [...document.querySelectorAll('#tabs [role="tab"]')];
    for (const tab of this._tabs) tab.addEventListener("click", () => this.open(tab.id.slice(4)));
    byId("tabs").addEventListener("keydown", (event) => this._key(event));
    this._select("teleop");
  }

  _key(event) {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const now = this._tabs.findIndex((tab) => tab.tabIndex === 0);
    const next = this._tabs.at((now + step) % this._tabs.length);
    this.open(next.id.slice(4));
    next.focus();
  }

  _select(name) {
    for (const tab of this._tabs) {
      const isIt = tab.id === `tab-${name}`;
      tab.setAttribute("aria-selected", String(isIt));
      tab.tabIndex = isIt ? 0 : -1;
      byId(tab.getAttribute("aria-controls")).hidden = !isIt;
      if (isIt) tab.scrollIntoView({ block: "nearest", inline: "nearest" });
    }
    this._name = name;
  }

  open(name) {
    this._select(name);
    this._setOpen(true);
    this._opened(name);
  }

  close() {
    this._setOpen(false);
  }

  toggle() {
    if (byId("panel").hidden) this.open(this._name);
    else this.close();
    if (!byId("panel").hidden) byId(`tab-${this._name}`).focus();
  }

  _setOpen(isOpen) {
    byId("panel").hidden = !isOpen;
    document.body.classList.toggle("panelled", isOpen);
    byId("open-panel").setAttribute("aria-expanded", String(isOpen));
  }
}
