"""Manual driving from a page: it holds only while the page says so at least every 0.2 s."""

from __future__ import annotations

import asyncio
import contextlib
import math
from typing import Any

from navloom import NavloomError
from navloom_live import Driver
from starlette.websockets import WebSocket, WebSocketDisconnect

from navloom_dashboard.acts import LONGEST, BadRequest, json_object, number
from navloom_dashboard.robot_link import RobotLink

__all__ = ["DEAD_MAN", "drive", "text_of"]

DEAD_MAN = 0.2
"""Longest silence of a page, s, after which the robot is commanded to stand: four messages of a page at 20 Hz.

With an interval here and a tick of the robot it is 0.3 s until the wheels are commanded to stand."""
LINK = 0.5
"""Longest time between what a page has heard and what it then asks, s: who sees the robot later may not drive it."""
INTERVAL = 0.05
"""Interval of commands to the robot, s."""


async def text_of(socket: WebSocket) -> str:
    """The next message of a page; empty if it is binary, which no page sends. Raises WebSocketDisconnect."""
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1005))
    return message.get("text") or ""


async def drive(socket: WebSocket, robot: RobotLink) -> None:
    """Drive while the websocket is open.

    When the page closes it, the robot is released to its own navigation. When it breaks, commands end, and the gate
    stops the robot until it is resumed, as with `navloom teleop`.
    """
    loop = asyncio.get_running_loop()
    wish: dict[str, Any] = {"v": 0.0, "w": 0.0, "at": -math.inf, "heard": -math.inf, "n": None}
    begun, closed = asyncio.Event(), False

    async def receive() -> None:
        nonlocal closed
        try:
            while True:
                said = json_object(await text_of(socket))
                if said.get("end"):
                    closed = True
                    return
                wish.update(v=number(said, "v"), w=number(said, "w"), n=said.get("n"), at=loop.time())
                if said.get("heard") is not None:
                    wish["heard"] = number(said, "heard", LONGEST)
                begun.set()
        except WebSocketDisconnect as left:
            closed = left.code == 1000
        except BadRequest as error:
            with contextlib.suppress(Exception):
                await socket.close(1008, str(error)[:100])

    listening = asyncio.create_task(receive())
    try:
        starting = asyncio.create_task(begun.wait())
        await asyncio.wait((listening, starting), return_when=asyncio.FIRST_COMPLETED)
        starting.cancel()
        if not listening.done():
            await robot.with_driver(lambda driver: _command(driver, wish, listening, socket, loop), lambda: closed)
    except NavloomError as error:
        with contextlib.suppress(Exception):
            await socket.send_json({"n": wish["n"], "error": str(error)})
            await socket.close(1011, "the robot cannot be driven")
    finally:
        listening.cancel()


async def _command(
    driver: Driver,
    wish: dict[str, Any],
    listening: asyncio.Task[None],
    socket: WebSocket,
    loop: asyncio.AbstractEventLoop,
) -> None:
    """Send the wish as long as the page is there; zero if the page is silent, or hears too late what the robot does."""
    answered, begun = None, loop.time()
    while not listening.done():
        late = wish["at"] - max(wish["heard"], begun)
        is_held = loop.time() - wish["at"] <= DEAD_MAN and wish["heard"] >= begun and late <= LINK
        v, w = (wish["v"], wish["w"]) if is_held else (0.0, 0.0)
        driver.send(v, math.degrees(w))
        if wish["n"] != answered or not is_held:
            answered = wish["n"]
            granted, measured = driver.granted, driver.measured
            await socket.send_json({
                "n": answered, "held": is_held, "limits": {"v": granted.vx, "w": granted.wz},
                "measured": {"v": measured.vx, "w": measured.wz}, "at": loop.time(),
                "limited_by": f"the link is too slow to drive: {late:.1f} s" if late > LINK else driver.limit,
            })  # fmt: skip
        await asyncio.sleep(INTERVAL)
