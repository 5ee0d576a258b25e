"""The web application: login, pages, robots' frames and acts. `navloom_live.guarded` is round it."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from typing import Any

from navloom import NavloomError
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from navloom_dashboard.acts import ACTS, LONGEST, BadRequest, json_object, number, parameters, text
from navloom_dashboard.outbox import text_frame
from navloom_dashboard.recordings import Recordings
from navloom_dashboard.robot_link import RobotLink
from navloom_dashboard.sessions import Right, Session, Sessions, TooManyLogins
from navloom_dashboard.teleop import drive, text_of

__all__ = ["Dashboard"]

PAGE = Path(__file__).with_name("page")
BODY = 65_536
"""Largest body of a request, bytes."""
BODY_WAIT = 5.0
"""Longest time until the body of a request is there, s."""
LOOK_AGAIN = 1.0
"""Interval of looking whether a session has ended while its page is open, s."""
MEMBERS_INTERVAL = 0.2
"""Interval of the poses of other robots, s."""
HEARTBEAT = 1.0
"""Interval of heartbeats of the STOP connection, s."""
RIGHTS: dict[str, Right] = {"operator": "operate", "viewer": "view"}
"""Right of each kind of certificate that may log in."""
ENDED = 4401
"""Code with which a websocket is closed when its session has ended: the page shows the login."""


class Dashboard:
    """The application, and the robots that it shows.

    Args:
        find: Robots that it should show now, by name: how to reach each.
        recordings: Where recordings go.
        cookie: Name of the session's cookie; one of each port, because browsers share cookies between ports.
        is_secure: It is served over TLS.
        kind_of: Kind of the identity whose certificate a request came with, by its scope; empty without one.
    """

    def __init__(
        self,
        find: Callable[[], Mapping[str, Any]],
        recordings: Path,
        cookie: str,
        is_secure: bool,
        kind_of: Callable[[Mapping[str, Any]], str] = lambda scope: "",
    ) -> None:
        self._kind_of = kind_of
        self.sessions = Sessions()
        self.robots: dict[str, RobotLink] = {}
        self._find, self._cookie, self._is_secure = find, cookie, is_secure
        self._recordings = Recordings(recordings)
        self._tasks: set[asyncio.Task[None]] = set()
        self._files = {path.relative_to(PAGE).as_posix(): path for path in PAGE.rglob("*") if path.is_file()}
        robot = "/{realm}/{name}"
        self.app = Starlette(
            routes=[
                Route("/", self._index),
                Route("/page/{path:path}", self._file),
                Route("/api/login", self._login, methods=["POST"]),
                Route("/api/logout", self._logout, methods=["POST"]),
                Route("/api/session", self._session),
                Route(f"/api{robot}/act", self._act, methods=["POST"]),
                Route(f"/api{robot}/params", self._params),
                Route(f"/api{robot}/doctor", self._doctor),
                Route(f"/api{robot}/recordings", self._list),
                Route(f"/api{robot}/recordings/{{file}}", self._download),
                WebSocketRoute(f"/ws{robot}", self._frames),
                WebSocketRoute(f"/stop{robot}", self._stop),
                WebSocketRoute(f"/teleop{robot}", self._teleop),
            ],
            exception_handlers={HTTPException: _told, NavloomError: _refused, TimeoutError: _refused},
            lifespan=self._lifespan,
        )

    # --- robots -----------------------------------------------------------------------------------------------------

    @contextlib.asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        running = [asyncio.create_task(self._look_for_robots()), asyncio.create_task(self._show_members())]
        try:
            yield
        finally:
            for task in running:
                task.cancel()
            await self._recordings.close()
            for link in self.robots.values():
                link.close()

    async def _look_for_robots(self) -> None:
        """Add robots that come up; one that goes down is kept, and shown as gone."""
        loop = asyncio.get_running_loop()
        while True:
            for name, where in (await loop.run_in_executor(None, self._find)).items():
                if name not in self.robots:
                    link = self.robots[name] = RobotLink(name, where, loop)
                    task = asyncio.create_task(link.run())
                    self._tasks.add(task)
                    task.add_done_callback(self._tasks.discard)
            await asyncio.sleep(LOOK_AGAIN)

    async def _show_members(self) -> None:
        """Show each robot the others in its world, and whether it is being recorded."""
        while True:
            poses = {name: (link.world, link.pose) for name, link in self.robots.items()}
            for name, link in self.robots.items():
                others = [pose for other, (world, pose) in poses.items()
                          if other != name and world == link.world and pose is not None]  # fmt: skip
                if others or "members" in link.latest:
                    link.show(text_frame("members", {"members": others}, None))
                found = self._recordings
                link.show(text_frame("recording", {"file": found.running(name), "why": found.failure(name)}, None))
            await asyncio.sleep(MEMBERS_INTERVAL)

    def _robot(self, connection: HTTPConnection) -> RobotLink:
        given = connection.path_params
        link = self.robots.get(f"{given['realm']}/{given['name']}")
        if link is None:
            raise HTTPException(
                404, f"there is no such robot; the dashboard shows {', '.join(self.robots) or 'none yet'}"
            )
        return link

    # --- sessions ---------------------------------------------------------------------------------------------------

    def _secret(self, connection: HTTPConnection) -> str:
        return connection.cookies.get(self._cookie, "")

    def _who(self, connection: HTTPConnection) -> Session | None:
        return self.sessions.find(self._secret(connection), asyncio.get_running_loop().time())

    def _viewer(self, connection: HTTPConnection) -> Session:
        session = self._who(connection)
        if session is None:
            raise HTTPException(401, "log in with the token that `navloom dashboard` printed")
        return session

    def _changer(self, request: Request) -> Session:
        """The session of a request that changes something. Raises HTTPException."""
        session = self._viewer(request)
        given = request.headers.get("x-csrf-token", "")
        if not hmac.compare_digest(given.encode("latin-1", "replace"), session.csrf.encode()):
            raise HTTPException(403, "the request has not the token of this session (X-CSRF-Token): reload the page")
        return session

    def _operator(self, request: Request) -> Session:
        session = self._changer(request)
        if session.right != "operate":
            raise HTTPException(403, "a viewer may not act: log in with the operator's token")
        if not session.may_act(asyncio.get_running_loop().time()):
            raise HTTPException(429, "too many requests: try again in a second")
        return session

    async def _login(self, request: Request) -> Response:
        given, now = await _json(request), asyncio.get_running_loop().time()
        if given.get("certificate"):
            scope = request.scope
            right = RIGHTS.get(self._kind_of(scope))
            if right is None:
                raise HTTPException(401, "the browser has no certificate of an operator or viewer of this robot")
            opened: tuple[str, Session] | None = self.sessions.begin(
                right, now, lambda: RIGHTS.get(self._kind_of(scope)) == right
            )
        else:
            try:
                opened = self.sessions.login(text(given, "token"), request.client.host if request.client else "", now)
            except TooManyLogins:
                raise HTTPException(429, "too many wrong tokens: try again in a minute") from None
        if opened is None:
            raise HTTPException(401, "wrong token: `navloom dashboard` prints the right one at its start")
        secret, session = opened
        answer = JSONResponse({"right": session.right, "csrf": session.csrf, "robots": list(self.robots)})
        answer.set_cookie(self._cookie, secret, httponly=True, samesite="strict", secure=self._is_secure, path="/")
        return answer

    async def _logout(self, request: Request) -> Response:
        self._changer(request)
        self.sessions.end(self._secret(request))
        answer = JSONResponse({"ok": True})
        answer.delete_cookie(self._cookie, path="/", httponly=True, samesite="strict", secure=self._is_secure)
        return answer

    async def _session(self, request: Request) -> Response:
        session = self._viewer(request)
        return _fresh({"right": session.right, "csrf": session.csrf, "robots": list(self.robots)})

    # --- files ------------------------------------------------------------------------------------------------------

    async def _index(self, request: Request) -> Response:
        return FileResponse(PAGE / "index.html", headers={"cache-control": "no-cache"})

    async def _file(self, request: Request) -> Response:
        # Only names that were there at the start: a path cannot lead anywhere else.
        path = self._files.get(request.path_params["path"])
        if path is None:
            raise HTTPException(404, "there is no such file")
        return FileResponse(path, headers={"cache-control": "no-cache"})

    async def _list(self, request: Request) -> Response:
        self._viewer(request)
        robot = self._robot(request).name
        found = self._recordings
        return _fresh({"recordings": found.files(robot), "recording": found.running(robot) is not None})

    async def _download(self, request: Request) -> Response:
        self._viewer(request)
        path = self._recordings.path(self._robot(request).name, request.path_params["file"])
        if path is None:
            raise HTTPException(404, "there is no such recording")
        return FileResponse(path, media_type="application/octet-stream", filename=path.name)

    # --- the robot --------------------------------------------------------------------------------------------------

    async def _act(self, request: Request) -> Response:
        self._operator(request)
        robot, given = self._robot(request), await _json(request)
        name = text(given, "act")
        if name == "record":
            return _fresh({"ok": True, **await self._record(robot, given)})
        if name not in ACTS:
            raise BadRequest(f"act is {name!r}, expected one of {', '.join([*ACTS, 'record'])}")
        return _fresh({"ok": True, **await robot.act(lambda navigator: ACTS[name](navigator, given))})

    async def _record(self, robot: RobotLink, given: Mapping[str, Any]) -> dict[str, Any]:
        if given.get("on"):
            return {"file": await self._recordings.start(robot.name, robot.where)}
        return {"file": await self._recordings.stop(robot.name)}

    async def _params(self, request: Request) -> Response:
        self._viewer(request)
        return _fresh({"nodes": await self._robot(request).look(parameters)})

    async def _doctor(self, request: Request) -> Response:
        self._viewer(request)
        found = await self._robot(request).look(lambda robot: robot.doctor())
        findings = [{"severity": one.severity, "what": one.what, "remedy": one.remedy} for one in found.findings]
        return _fresh({"robot": found.robot, "healthy": found.is_healthy, "nodes": found.nodes, "findings": findings,
                       "rate": None if found.rate is None else str(found.rate)})  # fmt: skip

    # --- websockets -------------------------------------------------------------------------------------------------

    async def _opened(self, socket: WebSocket, acts: bool) -> RobotLink | None:
        """Accept a websocket of a session; None, and it is refused, without the right."""
        session = self._who(socket)
        robot = self.robots.get(f"{socket.path_params['realm']}/{socket.path_params['name']}")
        status, why = 0, ""
        if session is None:
            status, why = 401, "log in first"
        elif acts and session.right != "operate":
            status, why = 403, "a viewer may not act"
        elif robot is None:
            status, why = 404, "there is no such robot"
        if status:
            await socket.send_denial_response(JSONResponse({"error": why}, status))
            return None
        await socket.accept()
        return robot

    async def _until_ended(self, socket: WebSocket) -> None:
        """Return when the session of an open page has ended."""
        while self._who(socket) is not None:
            await asyncio.sleep(LOOK_AGAIN)
        await socket.close(ENDED, "the session has ended")

    async def _frames(self, socket: WebSocket) -> None:
        robot = await self._opened(socket, acts=False)
        if robot is None:
            return

        async def send() -> None:
            while True:
                frame = await outbox.take()
                data = frame.wire(robot.age(frame), loop.time())
                await (socket.send_text(data) if isinstance(data, str) else socket.send_bytes(data))

        async def receive() -> None:
            while True:  # a page asks how long the way is, which it adds to the ages
                asked = json_object(await text_of(socket))
                outbox.put(text_frame("pong", {"ping": number(asked, "ping", LONGEST)}, None))

        loop = asyncio.get_running_loop()
        with robot.outbox() as outbox:
            await _first_of(send(), receive(), self._until_ended(socket))

    async def _stop(self, socket: WebSocket) -> None:
        robot = await self._opened(socket, acts=True)
        if robot is None:
            return

        async def stop(number: Any) -> None:
            try:
                await robot.stop()
                await socket.send_json({"n": number, "sent": True})
            except NavloomError as error:
                await socket.send_json({"n": number, "sent": False, "error": str(error)})

        async def receive() -> None:
            async with asyncio.TaskGroup() as group:
                while True:
                    said = json_object(await text_of(socket))
                    if "n" in said:
                        group.create_task(stop(said["n"]))

        async def beat() -> None:
            while True:
                await socket.send_json({"heartbeat": True})
                await asyncio.sleep(HEARTBEAT)

        await _first_of(receive(), beat(), self._until_ended(socket))

    async def _teleop(self, socket: WebSocket) -> None:
        robot = await self._opened(socket, acts=True)
        if robot is not None:
            await _first_of(drive(socket, robot), self._until_ended(socket))


async def _first_of(*coroutines: Any) -> None:
    """Run until the first of them ends, and cancel the others. A browser that leaves is no error."""
    tasks = [asyncio.ensure_future(one) for one in coroutines]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        for result in await asyncio.gather(*tasks, return_exceptions=True):
            _raise_unexpected(result)


def _raise_unexpected(result: Any) -> None:
    if isinstance(result, BaseExceptionGroup):
        for one in result.exceptions:
            _raise_unexpected(one)
    elif isinstance(result, Exception) and not isinstance(
        result, (WebSocketDisconnect, OSError, RuntimeError, BadRequest)
    ):
        raise result


async def _json(request: Request) -> dict[str, Any]:
    """The JSON object in a request. Raises BadRequest, HTTPException."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise HTTPException(415, "expected content-type application/json")
    body = b""
    try:
        async with asyncio.timeout(BODY_WAIT):
            async for part in request.stream():
                body += part
                if len(body) > BODY:
                    raise HTTPException(413, f"the request is larger than {BODY} bytes")
    except TimeoutError:
        raise HTTPException(408, f"the request was not complete within {BODY_WAIT:g} s") from None
    return json_object(body)


def _fresh(content: Any) -> Response:
    return JSONResponse(content, headers={"cache-control": "no-store"})


async def _told(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, error.status_code)


async def _refused(request: Request, error: Exception) -> Response:
    """A request that the robot, or this server, refuses."""
    status = 400 if isinstance(error, BadRequest) else 409
    return JSONResponse({"error": str(error)}, status)
