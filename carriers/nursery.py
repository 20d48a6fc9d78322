"""Starts carriers by forking from one process that has imported all they need.

A carrier on its own spends 0.25 s of processor time on imports, and ten of them share two cores.
The nursery never opens a Zenoh session and has one thread, so that a fork of it is a clean start;
its children are processes like any other. Requests come over a socket, one packet each, with the
file for the child's output; pids and exit codes go back.
"""

from __future__ import annotations

import json
import os
import select
import socket
import sys

from schemas.bus.entry import leave_with_launcher, pin_threads

POLL_S = 0.02
PACKET_BYTES = 65536


def main() -> int:
    """`python -m carriers.nursery FD`: serve until the launcher closes its end."""
    pin_threads()
    leave_with_launcher()
    import carriers.__main__
    import carriers.node
    import schemas.bus.zenoh_bus
    import sim_world.scenario

    with socket.socket(fileno=int(sys.argv[1])) as requests:
        while True:
            if select.select([requests], [], [], POLL_S)[0]:
                packet, files, _, _ = socket.recv_fds(requests, PACKET_BYTES, 1)
                if not packet:
                    return 0
                _fork(requests, json.loads(packet), files[0])
            _report_ended(requests)


def _fork(requests: socket.socket, arguments: list[str], output: int) -> None:
    """One more carrier, whose output goes to a file of its own."""
    pid = os.fork()
    if pid:
        os.close(output)
        requests.send(json.dumps({"started": pid}).encode())
        return
    requests.close()
    _become_carrier(arguments, output)


def _become_carrier(arguments: list[str], output: int) -> None:
    """The rest of a child's life: like `python -m carriers ARGUMENTS`."""
    from carriers.__main__ import main as carry

    code = 1
    try:
        os.setsid()
        for stream in (1, 2):
            os.dup2(output, stream)
        sys.argv = ["carriers", *arguments]
        os.environ["CROSSFIX_LAUNCHER"] = str(os.getppid())
        code = carry()
    except SystemExit as leaving:
        code = leaving.code if isinstance(leaving.code, int) else 1
    except BaseException:  # as the interpreter would: the traceback, then 1
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _report_ended(requests: socket.socket) -> None:
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if not pid:
            return
        ended = {"ended": pid, "code": os.waitstatus_to_exitcode(status)}
        requests.send(json.dumps(ended).encode())


if __name__ == "__main__":
    sys.exit(main())
