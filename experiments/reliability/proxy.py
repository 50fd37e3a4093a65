"""A way through the network that can be cut: connections are dropped, or nothing passes them any more."""

import asyncio
import contextlib
import socket
import struct
import threading


class Proxy:
    """Passes on what comes to ``address``, from a thread of its own, until the way is cut.

    Args:
        port: of this machine, to which it leads.
    """

    def __init__(self, port: int):
        self._port, self._loop = port, asyncio.new_event_loop()
        self._flows, self._dropped = asyncio.Event(), False
        self._writers: set[asyncio.StreamWriter] = set()
        self._flows.set()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        server = asyncio.start_server(self._connected, "127.0.0.1", 0)
        self._server = asyncio.run_coroutine_threadsafe(server, self._loop).result()
        self.address = f"tcp://127.0.0.1:{self._server.sockets[0].getsockname()[1]}"

    def silence(self) -> None:
        """Let nothing pass any more, on old connections or on new ones, as where all packets are lost."""
        self._loop.call_soon_threadsafe(self._flows.clear)

    def drop(self) -> None:
        """Reset all connections, and every new one."""

        def drop() -> None:
            self._dropped = True
            for writer in self._writers:
                _reset(writer)

        self._loop.call_soon_threadsafe(drop)

    def mend(self, after: float) -> None:
        """Let everything pass again; what waited, too.

        Args:
            after: so long from now, s.
        """

        def mend() -> None:
            self._dropped = False
            self._flows.set()

        self._loop.call_soon_threadsafe(self._loop.call_later, after, mend)

    def end(self) -> None:
        """Drop everything and end the thread."""

        async def end() -> None:
            self._server.close()
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            # What was reset is closed in the loop's next turn.
            await asyncio.sleep(0.01)

        asyncio.run_coroutine_threadsafe(end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        both = {writer}
        with contextlib.suppress(OSError, asyncio.CancelledError):
            await self._flows.wait()
            if not self._dropped:
                there, back = await asyncio.open_connection("127.0.0.1", self._port)
                both.add(back)
                self._writers |= both
                await asyncio.gather(self._passed_on(reader, back), self._passed_on(there, writer))
        self._writers -= both
        for one in both:
            _reset(one)

    async def _passed_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(2**16):
                await self._flows.wait()
                writer.write(data)
                await writer.drain()
        with contextlib.suppress(OSError):
            await self._flows.wait()
            writer.close()
            await writer.wait_closed()


def _reset(writer: asyncio.StreamWriter) -> None:
    """Close a connection at once, so that the other end sees it reset."""
    with contextlib.suppress(OSError):
        linger = struct.pack("ii", 1, 0)
        writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
    writer.transport.abort()
