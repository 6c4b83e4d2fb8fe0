"""Server of the Model Context Protocol: JSON-RPC 2.0 in lines on standard input and output."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

from ...core.version import __version__
from .tools import Tools, server_instructions

_VERSIONS = ("2025-11-25", "2025-06-18", "2025-03-26", "2024-11-05")
"""Versions of the protocol, the newest first."""
_MAX_LINE_LENGTH = 1 << 20
"""Largest line [bytes]."""
_MAX_NAME_LENGTH = 80
"""Number of characters of a name in a message."""
_MAX_PROBLEM_LENGTH = 200
"""Number of characters of an error of the JSON parser in a message."""

# Error codes of JSON-RPC 2.0
_PARSE_ERROR = -32700
_INVALID_REQUEST = -32600
_UNKNOWN_METHOD = -32601
_INVALID_PARAMS = -32602


class _ProtocolError(Exception):
    """Error that answers a request, with its code."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True)
class Server:
    """Server of tools."""

    tools: Tools

    def serve(self, requests: BinaryIO, answers: BinaryIO) -> None:
        """Answer one line after another until the input ends."""
        for line in _lines(requests):
            answer = self.answer(line)
            if answer is not None:
                text = json.dumps(answer, ensure_ascii=False, separators=(",", ":"))
                answers.write(text.encode() + b"\n")
                answers.flush()

    def answer(self, line: bytes | None) -> dict[str, Any] | None:
        """Answer to a line; None to a notification or an answer. ``line`` is None if it was too long."""
        request_id: Any = None
        try:
            request = _parse_request(line)
            request_id = request.get("id")
            is_notification = "id" not in request
            is_answer = "result" in request or "error" in request
            if is_notification or is_answer:
                return None
            method, params = _called_method(request)
            result = self._result(method, params)
        except _ProtocolError as problem:
            error = {"code": problem.code, "message": str(problem)}
            return {"jsonrpc": "2.0", "id": request_id, "error": error}
        return {"jsonrpc": "2.0", "id": request_id, "result": result}

    def _result(self, method: str, params: Mapping[str, Any]) -> dict[str, Any]:
        """Result of a method of the protocol."""
        if method == "initialize":
            requested_version = params.get("protocolVersion")
            newest_version = _VERSIONS[0]
            return {
                "protocolVersion": requested_version if requested_version in _VERSIONS else newest_version,
                "capabilities": {"tools": {}},
                "serverInfo": {"name": "twistwrench", "version": __version__},
                "instructions": server_instructions(self.tools.folder.path),
            }
        if method == "ping":
            return {}
        if method == "tools/list":
            return {"tools": [tool.description() for tool in self.tools.by_name.values()]}
        if method == "tools/call":
            return self._call_tool(params.get("name"), params.get("arguments") or {})  # null: no arguments
        raise _ProtocolError(_UNKNOWN_METHOD, f"unknown method {method[:_MAX_NAME_LENGTH]!r}")

    def _call_tool(self, name: Any, arguments: Any) -> dict[str, Any]:
        """Result of a tool in the form of the protocol: the text that it prints."""
        if not isinstance(name, str) or name not in self.tools.by_name:
            tool_names = ", ".join(self.tools.by_name)
            message = f"unknown tool {str(name)[:_MAX_NAME_LENGTH]!r}. Tools: {tool_names}."
            raise _ProtocolError(_INVALID_PARAMS, message)
        if not isinstance(arguments, dict):
            raise _ProtocolError(_INVALID_PARAMS, "arguments are an object: values by name")
        output = self.tools.call(name, arguments)
        return {"content": [{"type": "text", "text": output.text}], "isError": output.is_error}


def _lines(requests: BinaryIO) -> Iterator[bytes | None]:
    """Lines that are not blank; None for a line that is too long, whose rest is skipped."""
    while line := requests.readline(_MAX_LINE_LENGTH + 1):  # empty at the end
        if len(line) > _MAX_LINE_LENGTH:
            while line and not line.endswith(b"\n"):
                line = requests.readline(_MAX_LINE_LENGTH)
            yield None
        elif line.strip():
            yield line


def _called_method(request: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """Method of a request, and its parameters by name."""
    method = request.get("method")
    params = request.get("params", {})
    if not isinstance(method, str) or not isinstance(params, dict):
        raise _ProtocolError(_INVALID_REQUEST, "a request has a method, and parameters by name")
    return method, params


def _parse_request(line: bytes | None) -> dict[str, Any]:
    """Request of a line; raises for a line that is not one, or that was too long (None)."""
    if line is None:
        raise _ProtocolError(_INVALID_REQUEST, f"the line has more than {_MAX_LINE_LENGTH:,} bytes")
    try:
        request = json.loads(line)
    except (ValueError, RecursionError) as problem:
        raise _ProtocolError(_PARSE_ERROR, f"the line is not JSON: {str(problem)[:_MAX_PROBLEM_LENGTH]}") from None
    if not isinstance(request, dict):
        raise _ProtocolError(_INVALID_REQUEST, "a line holds one request, an object")
    return request
