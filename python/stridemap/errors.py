"""What can go wrong. Every exception of Stridemap's says where: ``file``, ``line`` and ``key``, as far as known."""

from __future__ import annotations


class StridemapError(Exception):
    """Any error of Stridemap's.

    Attributes:
        file: The text at fault: a file, ``built-in task NAME``, ``--set KEY=VALUE``; ``None`` if it is none.
        line: The line at fault in it, from 1; ``None`` if it is none.
        key: The key at fault; ``None`` if it is none.
    """

    file: str | None
    line: int | None
    key: str | None

    def __init__(
        self, message: str, *, file: str | None = None, line: int | None = None, key: str | None = None
    ) -> None:
        super().__init__(message)
        self.file, self.line, self.key = file, line, key


class RequestError(StridemapError, ValueError):
    """The request was wrong; nothing was done (exit code 2 of the command)."""


class WorkingError(StridemapError, RuntimeError):
    """Something went wrong while working; what was gathered is kept (exit code 1 of the command)."""
