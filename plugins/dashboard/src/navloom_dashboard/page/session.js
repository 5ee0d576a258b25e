// The session with the server: its right, and requests that carry its token against forged requests (CSRF).

export const session = { right: null, csrf: null, robots: [] };

async function request(path, options = {}) {
  let answer;
  try {
    answer = await fetch(path, { cache: "no-store", ...options });
  } catch {
    throw new Error("The dashboard does not answer: see whether `navloom dashboard` still runs.");
  }
  const said = await answer.json().catch(() => ({}));
  if (answer.ok) return said;
  const error = new Error(said.error || `The dashboard refused: ${answer.status} ${answer.statusText}`);
  error.status = answer.status;
  if (answer.status === 401) sessionEnded();
  throw error;
}

/** Shows the login, if there was a session. */
export function sessionEnded() {
  if (session.right) document.dispatchEvent(new Event("session-ended"));
}

/** Code with which the server closes the websockets of a session that has ended. */
export const ENDED = 4401;

const post = (path, body) =>
  request(path, {
    method: "POST",
    headers: { "Content-Type": "application/json", "X-CSRF-Token": session.csrf ?? "" },
    body: JSON.stringify(body),
  });

/** The token in the fragment of the address, which is removed from the address bar and from the history. */
export function tokenOfAddress() {
  const token = new URLSearchParams(location.hash.slice(1)).get("token");
  if (location.hash) history.replaceState(null, "", location.pathname + location.search);
  return token;
}

export async function login(token) {
  Object.assign(session, await post("/api/login", { token }));
  await continued();
}

/** Logs in with the certificate of the browser; raises if it has none that the robot admits. */
async function loginByCertificate() {
  Object.assign(session, await post("/api/login", { certificate: true }));
  await continued();
}

/** The session of the cookie, or of the browser's certificate; raises if there is none. */
export async function found() {
  if (location.protocol === "https:") await continued().catch(loginByCertificate);
  else await continued();
}

/** Continues the session of the cookie; raises if there is none. */
export async function continued() {
  Object.assign(session, await request("/api/session"));
}

export async function logout() {
  await post("/api/logout", {}).catch(() => {});
  Object.assign(session, { right: null, csrf: null, robots: [] });
}

const encoded = (robot) => robot.split("/").map(encodeURIComponent).join("/");
const of = (robot) => `/api/${encoded(robot)}`;
export const act = (robot, name, fields = {}) => post(`${of(robot)}/act`, { act: name, ...fields });
export const look = (robot, what) => request(`${of(robot)}/${what}`);
export const recordingAddress = (robot, name) => `${of(robot)}/recordings/${encodeURIComponent(name)}`;

/** Address of a websocket of the same server. */
export const socketAddress = (kind, robot) => {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  return `${scheme}://${location.host}/${kind}/${encoded(robot)}`;
};
