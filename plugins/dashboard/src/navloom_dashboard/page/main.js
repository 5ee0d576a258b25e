// The page: logs in, shows one robot, and joins the parts.

import { Camera } from "./camera.js";
import { Compare } from "./compare.js";
import { acting, byId, degrees, element, fixed, refusal, refuseActs, say, seconds, withCode, write } from "./dom.js";
import { Drawing, keyColours, palette } from "./draw.js";
import { listen } from "./gestures.js";
import { listenKeys } from "./keys.js";
import { Live, OLD } from "./live.js";
import { Tabs } from "./tabs.js";
import { showParams } from "./params.js";
import { Events, Record, layerButtons, showAges } from "./reports.js";
import { act, continued, found, login, logout, session, tokenOfAddress } from "./session.js";
import { STOPPED, Stop } from "./stop.js";
import { Teleop } from "./teleop.js";
import { Tool } from "./tools.js";

const VIEW_ONLY = "View only: log in with an operator's token to act.";
const canvas = byId("map");
const context = canvas.getContext("2d", { alpha: false });
const camera = new Camera();
const drawing = new Drawing(context, camera);
const isDark = matchMedia("(prefers-color-scheme: dark)");
const isCalm = matchMedia("(prefers-reduced-motion: reduce)");

let robot = null; // name of the one shown
let live, stop, teleop, compare, events, record;
let loads = null; // of the nodes, as shown
let isFitted = false;
let isDue = false;

/** Draws in the next frame; several calls before it are one. */
function changed() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(frame);
}

function frame() {
  isDue = false;
  if (!live) return;
  const { newest } = live;
  if (camera.follows && newest.pose && camera.chase(newest.pose, isCalm.matches)) changed();
  drawing.frame(live, tool, devicePixelRatio || 1);
  if (newest.state && newest.state.loads !== loads && !byId("panel-events").hidden) events.showLoads((loads = newest.state.loads ?? []));
  compare.show(newest.robot, drawing.colours, !byId("panel").hidden && !byId("panel-compare").hidden);
}

const tool = new Tool(camera, () => robot, changed);
const tabs = new Tabs((name) => {
  if (!robot) return;
  if (name === "params") showParams(byId("panel-params"), robot);
  if (name === "events") events.ask();
  if (name === "record") record.list();
  changed();
});

// --- the map -------------------------------------------------------------------------------------------------------

const painters = Object.fromEntries(["map", "sweep"].map((kind) => {
  const painter = new Worker("/page/map_worker.js");
  painter.onmessage = ({ data: { bitmap, message } }) => {
    if (message.robot !== robot) return bitmap.close(); // another one has been chosen meanwhile
    forget(kind);
    drawing.rasters[kind] = { bitmap, message };
    changed();
  };
  return [kind, painter];
}));

function forgetRasters() {
  Object.keys(painters).forEach(forget);
  isFitted = false;
}

function forget(kind) {
  drawing.rasters[kind]?.bitmap.close();
  delete drawing.rasters[kind];
}

function takeRaster(message) {
  painters[message.kind].postMessage({ ...message, robot });
  message.bytes = null;
  if (!isFitted) fit();
}

function fit() {
  const { sweep, pose, map = sweep } = live?.newest ?? {};
  watch(); // what is no more so covers nothing
  const covered = byId("notices").offsetHeight;
  if (map) {
    const [x, y, turn] = map.origin;
    const [w, h] = [map.width * map.resolution, map.height * map.resolution];
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    const xs = [0, c * w, c * w - s * h, -s * h].map((dx) => x + dx);
    const ys = [0, s * w, s * w + c * h, c * h].map((dy) => y + dy);
    if (pose) {
      xs.push(pose.x - 0.5, pose.x + 0.5);
      ys.push(pose.y - 0.5, pose.y + 0.5);
    }
    camera.fit([Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)], covered);
  } else if (pose) camera.fit([pose.x - 4, pose.y - 4, pose.x + 4, pose.y + 4], covered);
  isFitted = Boolean(live?.newest.map);
  showFollow();
  changed();
}

function paint() {
  drawing.colours = palette(isDark.matches);
  const { free, occupied, low, high } = drawing.colours;
  painters.map.postMessage({ colours: { free, occupied } });
  painters.sweep.postMessage({ colours: { free: low, occupied: high } });
  for (const [layer, colour] of Object.entries(keyColours(drawing.colours))) document.querySelector(`.key.${layer}`).style.background = colour;
  changed();
}
isDark.addEventListener("change", paint);

new ResizeObserver(() => {
  const { width, height } = canvas.getBoundingClientRect();
  const ratio = devicePixelRatio || 1;
  Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
  Object.assign(camera, { width, height });
  if (camera.isFit && !tool.isOn) fit();
  drawing.unit = parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;
  changed();
}).observe(canvas);
listen(canvas, camera, tool, () => {
  isFitted ||= !tool.isOn; // whoever has moved the map keeps it
  showFollow();
  changed();
});

function showFollow() {
  byId("follow").setAttribute("aria-pressed", String(camera.follows));
}
function follow() {
  camera.follows = !camera.follows;
  showFollow();
  changed();
}
const zoom = (factor, turn = 0) => (camera.zoom(factor, undefined, undefined, turn), changed());

// --- the robot -----------------------------------------------------------------------------------------------------

function show(name) {
  for (const part of [live, stop, teleop]) part?.close();
  robot = name;
  tool.close();
  forgetRasters();
  camera.follows = false;
  notice("lost", "");
  byId("recording").hidden = true;
  live = new Live(name);
  stop = new Stop(name, refusal);
  teleop = new Teleop(name, () => live.newest.robot?.limits ?? { v: 0, w: 0 }, refusal);
  compare = new Compare(byId("panel-compare"), name);
  events = new Events(byId("panel-events"), name);
  record = new Record(byId("panel-record"), name);
  live.addEventListener("news", ({ detail }) => take(detail));
  events.show([]);
  changed();
}

function take(kind) {
  const { newest } = live;
  if (kind in painters) takeRaster(newest[kind]);
  if (kind === "commands") compare.take(newest.commands);
  if (kind === "event") events.show(live.events);
  if (kind === "recording") record.take(newest.recording);
  if (kind === "state") showState(newest.state);
  if (kind === "pose") showPose(newest.pose);
  if (kind === "robot") teleop.show();
  if (kind === "gone") stop.take("robot is gone");
  if (kind === "back") forgetRasters();
  if (kind === "pose" && !isFitted && !newest.map) fit();
  changed();
}

const noticed = {};

/** Shows a notice over the map; a screen reader is told when it changes. */
function notice(id, text) {
  if (noticed[id] === text) return;
  noticed[id] = text;
  byId(id).replaceChildren(...(text ? withCode(text) : []));
}

function showPose({ state, reason }) {
  const isLost = state && state !== "tracking";
  notice("lost", isLost && `The localizer is ${state}${reason ? `: ${reason}` : ""} → \`navloom place\`, or \`navloom relocalise\``);
}

function showState(state) {
  const { goal } = state;
  write(byId("state"), state.latched ? "STOPPED" : goal?.state ?? "no goal");
  write(byId("progress"), goal?.distance ? `${fixed(goal.distance, 1)} m and ${fixed(goal.time_left, 0)} s left` : "");
  byId("state").classList.toggle("bad", Boolean(state.latched));
  write(byId("drives"), state.driver);
  write(byId("speed"), `${fixed(state.v)} m/s ${degrees(state.w)}/s`);
  write(byId("limit"), state.limit?.text && !state.stopped ? `slowed: ${state.limit.text}` : "");
  notice("why", state.why && `Stopped: ${state.why}${state.remedy ? ` → ${state.remedy}` : ""}`);
  byId("why").classList.toggle("calm", state.at_rest && !state.latched);
  stop.take(state.latched ? STOPPED : "");
  byId("resume").classList.toggle("strong", Boolean(state.latched));
}

/** Shows how old everything is, also while nothing arrives. */
function watch() {
  if (!live) return;
  const now = performance.now();
  showAges(live, OLD, now);
  const trouble = live.trouble(now);
  const banner = byId("banner");
  if (trouble) {
    write(byId("banner-text"), trouble.text);
    write(byId("banner-age"), `${seconds(trouble.age)} old`);
  }
  banner.hidden = !trouble;
  document.body.classList.toggle("old", Boolean(trouble));
}
setInterval(watch, 200);
setInterval(() => live?.ping(), 1000);

// --- acts ----------------------------------------------------------------------------------------------------------

const simple = (id, name, sent) => acting(byId(id), async () => {
  const answer = await act(robot, name);
  say(answer.text || sent);
});
simple("cancel", "cancel", "The goal is cancelled.");
simple("relocalise", "relocalise", "The robot searches for itself on the whole map.");
simple("clear", "clear", "The robot has forgotten what it has mapped.");
simple("resume", "resume", "The robot may drive again.");
// At the press, not at the release: a finger that slips off has meant it.
byId("stop").addEventListener("pointerdown", (event) => event.button === 0 && stop?.press());
byId("stop").addEventListener("click", (event) => event.detail === 0 && stop?.press());

const click = (id) => () => byId(id).click();
const arrow = (dx, dy) => (event) => {
  if (event.target === canvas && !tool.isOn) camera.pan(40 * dx, 40 * dy), showFollow(), changed();
};
canvas.addEventListener("keydown", (event) => {
  if (!tool.isOn || event.ctrlKey || event.metaKey || !tool.key(event)) return;
  event.preventDefault();
  event.stopPropagation();
});
listenKeys(() => stop?.press(), {
  r: click("resume"), g: click("tool-goal"), p: click("tool-pose"), c: click("cancel"), l: click("relocalise"), o: click("open-panel"),
  m: () => canvas.focus(), f: follow, 0: fit, "?": click("open-help"),
  t: () => (tabs.open("teleop"), byId("stick").focus()),
  "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), "[": () => zoom(1, Math.PI / 12), "]": () => zoom(1, -Math.PI / 12),
  ArrowLeft: arrow(1, 0), ArrowRight: arrow(-1, 0), ArrowUp: arrow(0, 1), ArrowDown: arrow(0, -1),
  Escape: () => (tool.isOn ? tool.close() : tabs.close()),
}, () => Boolean(robot));
for (const [id, action] of Object.entries({
  "zoom-in": () => zoom(1.25), "zoom-out": () => zoom(0.8), "turn-left": () => zoom(1, Math.PI / 12), "turn-right": () => zoom(1, -Math.PI / 12),
  fit, follow, "open-help": () => byId("help").showModal(), "open-panel": () => tabs.toggle(), logout: () => logout().then(end),
})) byId(id).addEventListener("click", action);
layerButtons(byId("layers"), drawing.shown, changed);

// --- the session ---------------------------------------------------------------------------------------------------

/** Time between two looks for robots that have come up, ms. */
const LOOK = 3000;

function begin() {
  byId("login").hidden = true;
  document.body.classList.add("in");
  write(byId("right"), session.right === "operate" ? "operator" : "viewer");
  refuseActs(session.right === "operate" ? "" : VIEW_ONLY);
  document.body.classList.toggle("views", session.right !== "operate");
  byId("robot").replaceChildren();
  listRobots();
  if (!robot) notice("lost", "No robot is up → `navloom up` starts one.");
}

/** Adds robots that have come up to the choice, and shows the first one. */
function listRobots() {
  const choice = byId("robot");
  const listed = new Set([...choice.options].map(({ value }) => value));
  choice.append(...session.robots.filter((name) => !listed.has(name)).map((name) => element("option", { value: name }, name)));
  if (!robot && session.robots.length) show(session.robots[0]);
}
byId("robot").addEventListener("change", () => show(byId("robot").value));
setInterval(() => session.right && !document.hidden && continued().then(listRobots, () => {}), LOOK);

function end(message = "") {
  for (const part of [live, stop, teleop]) part?.close();
  live = stop = teleop = robot = null;
  document.body.classList.remove("in");
  byId("login").hidden = false;
  write(byId("login-error"), typeof message === "string" ? message : "");
  byId("token").focus();
}
document.addEventListener("session-ended", () => end("The session has ended: log in again."));

byId("login-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  try {
    await login(byId("token").value.trim());
    byId("token").value = "";
    begin();
  } catch (error) {
    write(byId("login-error"), error.message);
  }
});

async function start() {
  paint();
  const token = tokenOfAddress();
  try {
    await (token ? login(token) : found());
    begin();
  } catch (error) {
    end(token ? error.message : "");
  }
}
start();
