"""Who may see and who may operate: login tokens, sessions that end, and a limit on wrong logins."""

from __future__ import annotations

import hmac
import secrets
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from navloom import NavloomError

__all__ = ["Right", "Session", "Sessions", "TooManyLogins"]

Right = Literal["view", "operate"]
IDLE_LIMIT = 3600.0
"""Time after which a session ends that no request and no open page uses, s."""
LIFETIME = 12 * 3600.0
"""Longest session, s: a working day."""
MOST_SESSIONS = 64
"""Most sessions at once; one more ends the one that has been idle longest."""
WRONG_LOGINS, WRONG_WINDOW = 10, 60.0
"""Most wrong logins of one address, in s. A token has 144 random bits, so this only keeps the log short."""
MOST_ADDRESSES = 1024
"""Most addresses whose wrong logins are remembered."""


ACTS_AT_ONCE, ACTS_RATE = 20.0, 10.0
"""Acts that a session may send at once, and per s in the long run."""


class TooManyLogins(NavloomError):
    """An address has sent too many wrong tokens; it may try again later."""


@dataclass
class Session:
    """A browser that has logged in.

    Attributes:
        right: What it may do.
        csrf: What its requests that change something must carry, which other sites cannot know.
        began, used: Times of login and last use, s.
        holds: Whether what it was opened with is still good; a certificate may be revoked.
    """

    right: Right
    csrf: str
    began: float
    used: float
    holds: Callable[[], bool] = lambda: True
    _left: float = ACTS_AT_ONCE
    _acted: float = 0.0

    def may_act(self, now: float) -> bool:
        """Count an act; whether it is not one too many."""
        self._left = min(ACTS_AT_ONCE, self._left + ACTS_RATE * (now - self._acted))
        self._acted = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass
class Sessions:
    """The tokens, and the sessions that were opened with them. Every time is that of one monotonic clock, s.

    Attributes:
        tokens: Token of each right; generated.
    """

    tokens: dict[Right, str] = field(
        default_factory=lambda: {"operate": secrets.token_urlsafe(18), "view": secrets.token_urlsafe(18)}
    )
    _open: dict[str, Session] = field(default_factory=dict)
    _wrong: dict[str, deque[float]] = field(default_factory=dict)

    def login(self, token: str, address: str, now: float) -> tuple[str, Session] | None:
        """Open a session with a token; None if no right has that token.

        Returns:
            The secret of the session's cookie, and the session.

        Raises:
            TooManyLogins: The address has sent WRONG_LOGINS wrong tokens within WRONG_WINDOW.
        """
        wrong = self._wrong.setdefault(address, deque(maxlen=WRONG_LOGINS))
        if len(wrong) == WRONG_LOGINS and now - wrong[0] < WRONG_WINDOW:
            raise TooManyLogins
        given = token.encode()
        rights = [right for right, known in self.tokens.items() if hmac.compare_digest(known.encode(), given)]
        if not rights:
            wrong.append(now)
            if len(self._wrong) > MOST_ADDRESSES:
                del self._wrong[next(iter(self._wrong))]
            return None
        self._wrong.pop(address, None)
        return self.begin(rights[0], now)

    def begin(self, right: Right, now: float, holds: Callable[[], bool] = lambda: True) -> tuple[str, Session]:
        """Open a session with a right, as long as that holds; the secret of its cookie, and the session."""
        self._end_old(now)
        if len(self._open) >= MOST_SESSIONS:
            del self._open[min(self._open, key=lambda secret: self._open[secret].used)]
        secret = secrets.token_urlsafe(24)
        session = self._open[secret] = Session(right, secrets.token_urlsafe(18), now, now, holds)
        return secret, session

    def find(self, secret: str, now: float) -> Session | None:
        """The session of a cookie, which counts as used; None if there is none, or it has ended."""
        self._end_old(now)
        session = self._open.get(secret)
        if session is not None and not session.holds():
            del self._open[secret]
            return None
        if session is not None:
            session.used = now
        return session

    def end(self, secret: str) -> None:
        """End a session."""
        self._open.pop(secret, None)

    def _end_old(self, now: float) -> None:
        for secret, session in list(self._open.items()):
            if now - session.used > IDLE_LIMIT or now - session.began > LIFETIME:
                del self._open[secret]
