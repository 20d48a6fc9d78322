"""One run as containers: what `docker compose` makes of our file, and what comes of it."""

from __future__ import annotations

import json
import os
import re
import shlex
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import msgspec

from schemas import codec, keys
from schemas.bus.interface import Bus, Inbox, Sample
from tests.containers.engine import compose_command, docker, run

RUN = "strait"
SERVICES = ("hub", "world", "levante", "poniente", "siroco", "fusion")
RECORDINGS = "/crossfix/recordings"
DEADLINE_S = 120.0
T = TypeVar("T", bound=msgspec.Struct)


class Composed:
    """A compose project of its own; `with` removes its containers, network and volume."""

    def __init__(self, checkout: Path, image: str, duration_s: int) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = str(probe.getsockname()[1])
        self.endpoint = f"tcp/127.0.0.1:{port}"
        self._checkout, self._name = checkout, f"{image}-{duration_s}"
        self._variables = {
            "CROSSFIX_IMAGE": image,
            "CROSSFIX_PORT": port,
            "CROSSFIX_DURATION_S": str(duration_s),
            "COMPOSE_PROJECT_NAME": self._name,
        }

    def __enter__(self) -> Composed:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            error.add_note(self.compose("logs", "--no-color")[-4000:])
        self.compose("down", "--volumes", "--timeout", "1")

    def compose(self, *arguments: str) -> str:
        """What a compose command prints."""
        command = [*compose_command(), *arguments]
        return run(command, cwd=self._checkout, timeout_s=DEADLINE_S, **self._variables).stdout

    @property
    def network(self) -> str:
        """Name of the network of its containers."""
        return f"{self._name}_default"

    def shell(self, line: str) -> str:
        """What a line prints that is typed beside the compose file."""
        command = ["/bin/sh", "-c", self._here(line)]
        return run(command, cwd=self._checkout, timeout_s=DEADLINE_S, **self._variables).stdout

    def started(self, line: str) -> subprocess.Popen[bytes]:
        """A line that is typed and not waited for."""
        environment = os.environ | self._variables
        return subprocess.Popen(shlex.split(self._here(line)), cwd=self._checkout, env=environment)

    def container(self, service: str) -> str:
        """Id of a service's container, also of one that has ended."""
        labels = {"project": self._name, "service": service}
        filters = [f"--filter=label=com.docker.compose.{k}={v}" for k, v in labels.items()]
        return docker("ps", "--all", "--quiet", "--no-trunc", *filters)

    def inspected(self, service: str) -> dict[str, Any]:
        """Everything the engine knows of a container."""
        found: list[dict[str, Any]] = json.loads(docker("inspect", self.container(service)))
        return found[0]

    def exit_codes(self) -> dict[str, int]:
        """Exit code of every service's container; waits for those that still run."""
        return {service: int(docker("wait", self.container(service))) for service in SERVICES}

    def is_healthy(self, process: str, asked_in: str = "hub") -> bool:
        """What the health check says of a process."""
        command = ["docker", "exec", self.container(asked_in), "healthy", RUN, process]
        return run(command, check=False).returncode == 0

    @contextmanager
    def cut_off(self, service: str) -> Iterator[None]:
        """Take a container out of the network for a while."""
        container = self.container(service)
        docker("network", "disconnect", self.network, container)
        try:
            yield
        finally:
            docker("network", "connect", self.network, container)

    def _here(self, line: str) -> str:
        """A line with compose as it is called here, and with this Python."""
        line = line.replace("docker compose", " ".join(compose_command()))
        return re.sub(
            "^(python|crossfix) ",
            lambda found: f"{sys.executable} {'-m crossfix ' * (found[1] == 'crossfix')}",
            line,
        )

    def fetch_recording(self, folder: Path) -> Path:
        """A copy of the recording from the volume."""
        docker("cp", f"{self.container('fusion')}:{RECORDINGS}/{RUN}.mcap", str(folder))
        return folder / f"{RUN}.mcap"


class Onlooker:
    """Hears a run from outside, through the hub's published port."""

    def __init__(self, bus: Bus, *topics: keys.Topic) -> None:
        self._inbox: Inbox[Sample] = Inbox()
        for topic in topics:
            bus.subscribe(topic.every(RUN), self._inbox)

    def await_message(self, kind: type[T], wanted: Callable[[T], bool]) -> T:
        """The next message of a kind that is as wanted."""
        deadline_s = time.monotonic() + DEADLINE_S
        while time.monotonic() < deadline_s:
            for sample in self._inbox.take(0.05):
                if keys.parse(sample.key).topic.message is kind:
                    message = codec.decode(kind, sample.payload)
                    if wanted(message):
                        return message
        raise AssertionError(f"no such {kind.__name__} in {DEADLINE_S:g} s")
