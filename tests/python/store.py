"""A store that speaks S3, on this machine, behind a proxy that cuts connections, loses answers, and tells of requests."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable, Iterator

import boto3
from moto.server import ThreadedMotoServer

KEYS = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_REGION": "us-east-1"}


def serve() -> Iterator[tuple[str, int]]:
    """A server, until the next step of the iterator."""
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    yield server.get_host_and_port()
    server.stop()


def client(server: tuple[str, int]):  # noqa: ANN201
    """A client that goes to the server itself."""
    host, port = server
    keys = {"aws_access_key_id": "test", "aws_secret_access_key": "test", "region_name": "us-east-1"}
    return boto3.client("s3", endpoint_url=f"http://{host}:{port}", **keys)


class Proxy:
    """Passes bytes on to a server, and what is asked for of what goes wrong."""

    def __init__(self, server: tuple[str, int]) -> None:
        self.server = server
        # An answer is cut after so many bytes.
        self.cut_after: int | None = None
        # So many requests are cut after 100 kB.
        self.n_cut_requests = 0
        # So many answers to requests for a name that must be free are lost.
        self.n_lost_answers = 0
        # Told of the bytes of answers, and of the first line of each request.
        self.on_bytes: Callable[[int], None] | None = None
        self.on_request: Callable[[str], None] | None = None
        self.n_cuts = 0
        self.guard = threading.Lock()
        # The server looks whether a name is free, then writes; a store does both at once.
        self.conditional = threading.Lock()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self.listener.getsockname()[1]
        threading.Thread(target=self.accept, daemon=True).start()

    def env(self) -> dict[str, str]:
        """The environment of a program that goes through the proxy."""
        return {**os.environ, **KEYS, "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.port}", "AWS_ALLOW_HTTP": "true"}

    def accept(self) -> None:
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            Connection(self, client, socket.create_connection(self.server))

    def takes(self, counter: str) -> bool:
        """Is one of so many left?"""
        with self.guard:
            n_left = getattr(self, counter)
            setattr(self, counter, max(n_left - 1, 0))
            self.n_cuts += n_left > 0
            return n_left > 0


class Connection:
    """One connection, in both directions."""

    def __init__(self, proxy: Proxy, client: socket.socket, server: socket.socket) -> None:
        self.proxy, self.client, self.server = proxy, client, server
        self.is_conditional = False
        for run in (self.ask, self.answer):
            threading.Thread(target=self.until_cut, args=(run,), daemon=True).start()

    def until_cut(self, run: Callable[[], None]) -> None:
        try:
            run()
        except OSError:
            pass
        self.release()
        for end in (self.client, self.server):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def release(self) -> None:
        with self.proxy.guard:
            if self.is_conditional:
                self.is_conditional = False
                self.proxy.conditional.release()

    def ask(self) -> None:
        n_bytes = 0
        while piece := self.client.recv(1 << 16):
            method = piece.split(b" ", 1)[0]
            if method in (b"PUT", b"POST", b"GET", b"HEAD", b"DELETE"):
                n_bytes = 0
                if self.proxy.on_request:
                    self.proxy.on_request(piece.split(b"\r\n", 1)[0].decode())
                if b"if-none-match: *" in piece.lower():
                    self.proxy.conditional.acquire()
                    self.is_conditional = True
            n_bytes += len(piece)
            if n_bytes > 100_000 and self.proxy.takes("n_cut_requests"):
                return
            self.server.sendall(piece)

    def answer(self) -> None:
        n_bytes = 0
        while piece := self.server.recv(1 << 16):
            if self.is_conditional and b" 100 " not in piece[:16] and self.proxy.takes("n_lost_answers"):
                return
            self.release()
            n_bytes += len(piece)
            if self.proxy.on_bytes:
                self.proxy.on_bytes(n_bytes)
            if self.proxy.cut_after and n_bytes > self.proxy.cut_after:
                self.proxy.n_cuts += 1
                return
            self.client.sendall(piece)
