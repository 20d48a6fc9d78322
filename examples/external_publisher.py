"""A stranger takes part in a run, with nothing but eclipse-zenoh and msgpack.

    crossfix run scenarios/strait.toml --rate 20          # in one terminal
    python examples/external_publisher.py --run strait    # in another

It is one more carrier: a ship at anchor with a radar, whose own idea of where it is and where north
lies is wrong. It says what its radar is, where it believes to be, and at every step what it sees;
the fusion centre finds out how wrong it is, and the answer is printed; with --use-corrections all
that is said from then on is right. docs/publishing.md explains each part, docs/wire.md lists every
field.
"""

import argparse
import json
import queue
import random
import secrets
import sys
import time
from collections import defaultdict
from math import atan2, cos, degrees, dist, pi, radians, sin
from typing import Any

import msgpack
import zenoh

RADAR: dict[str, Any] = {
    "kind": "radar",
    "coordinates": "bearing_range",
    "period_s": 1.0,
    "sigma_bearing_rad": radians(0.3),
    "sigma_range_m": 30.0,
    "range_max_m": 25_000.0,
}
TRULY_AT_M = (3000.0, -2500.0, 20.0)  # east, north, up of the scenario's origin
POSITION_ERROR_M = (900.0, -600.0)  # added to it in what is reported: we know no better
NORTH_ERROR_RAD = radians(1.5)  # our north points so far to the right of true north
SIGMA_POSITION_M, SIGMA_NORTH_RAD = 1000.0, radians(1.0)  # what we admit to: the fusion's prior
SILENCE_S = 15.0  # the world speaks four times a second; so long without a word, it is gone
BEHIND = 20  # messages that wait for us

Message = dict[str, Any]


class Publisher:
    """Numbers, sends and keeps what a carrier says, and answers for what was lost on the way."""

    def __init__(self, session: zenoh.Session, root: str, name: str) -> None:
        self.session, self.root, self.name = session, root, name
        self.boot = secrets.token_hex(8)  # one life of this process
        self.sent: dict[str, list[Message]] = defaultdict(list)  # by stream, seq 1 first
        session.declare_queryable(f"{root}/backfill/{name}", self.backfill)
        session.declare_queryable(f"{root}/source/{name}/radar", self.source_info)

    def send(self, key: str, kind: str, stream: str, fields: Message) -> None:
        """Publish one message; `seq` counts from 1 without a hole within each stream."""
        own = {"carrier": self.name, "boot": self.boot, "stream": stream}
        payload = msgpack.packb({**own, "seq": len(self.sent[stream]) + 1, **fields})
        encoding = f"application/msgpack;crossfix.{kind}"
        self.session.put(f"{self.root}/{key}", payload, encoding=encoding)
        kept = {"key": f"{self.root}/{key}", "encoding": encoding, "payload": payload}
        self.sent[stream].append(kept)  # a minute of it is enough, where memory is short

    def ack(self, step: int) -> None:
        """Say that all of a step is out, and how far each stream has come; step 0: ready."""
        own = {"carrier": self.name, "boot": self.boot}
        ends = [{**own, "stream": s, "last_seq": len(sent)} for s, sent in self.sent.items()]
        message = {"process": self.name, "boot": self.boot, "step": step, "manifest": ends}
        self.session.put(f"{self.root}/ack/{self.name}", msgpack.packb(message), express=True)

    def backfill(self, query: zenoh.Query) -> None:
        """Somebody missed messages `first` to `last` of a stream: here they are once more."""
        asked = msgpack.unpackb(query.payload.to_bytes())
        ours = asked["boot"] in ("", self.boot)
        records = self.sent[asked["stream"]][asked["first"] - 1 : asked["last"]] if ours else []
        query.reply(query.key_expr, msgpack.packb({"records": records[:500]}))

    def source_info(self, query: zenoh.Query) -> None:
        """Somebody came late and asks what the radar is."""
        query.reply(query.key_expr, self.sent["info"][-1]["payload"])


def look(truth: Message, dice: random.Random) -> Message:
    """What the radar sees: target logs as columns; no column at all where it sees nothing.

    A STAND-IN for a real sensor, so that there is something to see: it takes the truth of the
    simulation, which no real publisher knows, and spoils it.
    """
    logs: dict[str, list[Any]] = defaultdict(list)
    for place, identity in zip(truth["position_m"], truth["identity"], strict=True):
        east, north = place[0] - TRULY_AT_M[0], place[1] - TRULY_AT_M[1]
        bearing = atan2(east, north) - NORTH_ERROR_RAD + dice.gauss(0, RADAR["sigma_bearing_rad"])
        range_m = dist(place, TRULY_AT_M) + dice.gauss(0, RADAR["sigma_range_m"])
        if 0 < range_m < RADAR["range_max_m"]:
            logs["bearing_rad"].append(bearing % (2 * pi))
            logs["range_m"].append(range_m)
            logs["identity"].append(identity or None)  # a name that others see too, as an MMSI
            logs["identity_kind"].append("name" if identity else None)
    return dict(logs)


def believed_pose(origin: Message) -> Message:
    """Where we say we are, and the covariance of (east, north, north direction)."""
    east, north = (p + e for p, e in zip(TRULY_AT_M[:2], POSITION_ERROR_M, strict=True))
    curved = 1 - 0.00669438 * sin(origin["latitude_rad"]) ** 2  # WGS84
    metres_north = 6378137 * 0.99330562 / curved**1.5  # of one radian of latitude
    metres_east = 6378137 / curved**0.5 * cos(origin["latitude_rad"])
    return {
        "latitude_rad": origin["latitude_rad"] + north / metres_north,
        "longitude_rad": origin["longitude_rad"] + east / metres_east,
        "altitude_m": TRULY_AT_M[2],
        "covariance": [SIGMA_POSITION_M**2, 0, 0, SIGMA_POSITION_M**2, 0, SIGMA_NORTH_RAD**2],
    }


def ask(session: zenoh.Session, key: str, question: Message | None = None) -> Message:
    """What the owner of a key answers, asked until it is there.

    Raises:
        TimeoutError: it is not there for long.
    """
    deadline_s = time.monotonic() + SILENCE_S
    while time.monotonic() < deadline_s:
        for reply in session.get(key, payload=msgpack.packb(question), timeout=0.5):
            if reply.ok is not None:
                return msgpack.unpackb(reply.ok.payload.to_bytes())
        time.sleep(0.02)
    raise TimeoutError(f"nobody answers for {key}")


def corrected(pose: Message, logs: Message, correction: Message, t_ns: int) -> list[Message]:
    """What to say of our place and of what we see with a correction; as they are without one."""
    if (add := correction.get("feedback")) is None:
        return [{"pose": pose}, logs]
    passed_s = (t_ns - correction["valid_t_ns"]) / 1e9
    right = {**pose, "covariance": add["covariance"]}
    for angle in ("latitude_rad", "longitude_rad"):
        right[angle] += add[angle] + passed_s * add.get(f"{angle}_s", 0.0)
    turned = [(bearing + add["north_rad"]) % (2 * pi) for bearing in logs.get("bearing_rad", [])]
    name = {"correction_id": correction["id"]}
    return [
        {"pose": right, "uncorrected": pose, **name},
        {**logs, "bearing_rad": turned, "turned_rad": add["north_rad"], **name},
    ]


def observe(
    us: Publisher, step: Message, pose: Message, correction: Message, *, answer: bool
) -> None:
    """Say everything there is to say at one step, with a correction unless it is empty."""
    number = step["step"]
    question = {"boot": "", "stream": "truth/targets", "first": number, "last": number}
    kept = ask(us.session, f"{us.root}/backfill/world", question)["records"]
    if not kept:
        return  # too long ago for the world to know
    logs = look(msgpack.unpackb(kept[0]["payload"]), random.Random(f"{us.name} {number}"))  # noqa: S311
    # A step of 0 in the envelope: the fusion centre takes whatever has come by then.
    when = {"t_ns": step["t_ns"], "step": number if answer else 0}
    if not us.sent["info"]:
        info = {"source": "radar", "properties": RADAR}
        us.send(f"source/{us.name}/radar", "SourceInfo", "info", {**when, **info})
    where, seen = corrected(pose, logs, correction, step["t_ns"])
    navigation = {**where, "kind": "fix"}
    us.send(f"navigation/{us.name}", "Navigation", "navigation", {**when, **navigation})
    us.send(f"report/{us.name}/radar", "SourceReport", "radar", {**when, **seen})


def told(correction: Message) -> str:
    """A correction in words: what it does to our place and to our bearings."""
    text = f"step {correction['step']}: correction {correction['state']}"
    if (frame := correction.get("own_axes")) is None:
        return f"{text}: {correction.get('reason', '')}"
    east = frame["east_m"] - frame["reported_east_m"]
    north = frame["north_m"] - frame["reported_north_m"]
    turn = degrees(frame["rotation_rad"])
    return f"{text}: {east:+.0f} m east, {north:+.0f} m north, bearings {turn:+.2f} deg"


def take_part(
    session: zenoh.Session, run: str, name: str, *, answer: bool, use_corrections: bool
) -> str:
    """Join a run, observe every step, print what the corrections do; why it ended."""
    root = f"crossfix/@v1/{run}"
    pose = believed_pose(ask(session, f"{root}/scenario")["origin"])
    us = Publisher(session, root, name)
    heard: queue.Queue[zenoh.Sample] = queue.Queue()
    session.declare_subscriber(f"{root}/step", heard.put)  # a callback only ever puts aside
    session.declare_subscriber(f"{root}/correction/*/{name}", heard.put)
    token = session.liveliness().declare_token(f"{root}/alive/{name}/{us.boot}")
    print(f"{name} takes part in {run}, boot {us.boot}", flush=True)
    done, state, ended = 0, "", ""
    correction: Message = {}
    while True:
        if answer:
            us.ack(done)
        try:
            sample = heard.get(timeout=1.0 if ended else SILENCE_S)
        except queue.Empty:  # an ended world speaks on until the fusion centre has finished
            token.undeclare()
            return ended or "the world is silent"
        message = msgpack.unpackb(sample.payload.to_bytes())
        if "/correction/" in str(sample.key_expr):
            if message["state"] != state:
                state = message["state"]
                print(told(message), flush=True)
            correction = message if use_corrections else {}
        elif us.boot in message.get("given_up", []):
            return "given up by the world, for it did not hear from us: start again"
        elif message.get("ended"):
            ended = message["ended"]
        elif message["step"] > done:
            done = message["step"]
            if answer or heard.qsize() < BEHIND:  # rather miss a step than be late at all of them
                observe(us, message, pose, correction, answer=answer)


def main() -> None:
    """Read the command line and take part."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--run", required=True, help="name of the run, by default the scenario's")
    parser.add_argument("--name", default="visitor", help="of this carrier")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", help="endpoint of the hub")
    parser.add_argument("--answer-steps", action="store_true", help="in lock-step, be waited for")
    parser.add_argument("--use-corrections", action="store_true", help="say all as corrected")
    given = parser.parse_args()
    config = zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": "client",
                "connect": {"endpoints": [given.connect], "timeout_ms": 30_000},
                "transport": {"shared_memory": {"enabled": False}},
            }
        )
    )
    try:
        session = zenoh.open(config)
    except zenoh.ZError:
        sys.exit(f"no hub at {given.connect}: `crossfix run` says where it listens")
    with session:
        try:
            how = {"answer": given.answer_steps, "use_corrections": given.use_corrections}
            reason = take_part(session, given.run, given.name, **how)
        except TimeoutError:
            reason = "the world is silent"
        print("ended:", reason)


if __name__ == "__main__":
    main()
