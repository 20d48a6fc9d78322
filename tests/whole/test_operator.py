"""An operator suspends a correction in mid-run: an event, recorded, and fused again alike."""

from __future__ import annotations

from pathlib import Path

from schemas import codec, keys
from schemas.bus.memory_bus import MemoryNetwork
from schemas.messages import Answer, Command, Correction, Event
from sim_world.scenario import parse_scenario
from tests.whole.in_memory import MemoryRun
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

SCENARIO = Path(__file__).with_name("small.toml")


def ask(run: MemoryRun, command: Command, form: str = "msgpack") -> Answer:
    encode = codec.encode if form == "msgpack" else codec.encode_json
    with run.network.bus("operator") as bus:
        key, payload = keys.COMMAND.key(run.run, keys.FUSION), encode(command)
        (reply,) = bus.query(key, payload, codec.encoding_of(Command, form), 5.0)
        assert reply.encoding == codec.encoding_of(Answer, form)
        return codec.decode(Answer, reply.payload, reply.encoding)


def test_a_command_becomes_an_event_once_and_a_bad_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    scenario = parse_scenario(SCENARIO.read_text(), SCENARIO.name)
    answers = []

    def command(run: MemoryRun) -> None:
        run.await_step(10)
        suspend = Command(id="one", kind="suspend", carrier="bravo")
        answers.extend([ask(run, suspend), ask(run, suspend, "json")])
        answers.append(ask(run, Command(id="two", kind="set", setting="association.gat", value=1)))

    with MemoryNetwork(1, delay_s=(0.0, 0.01)) as network:
        MemoryRun(scenario, network, path).carry_out(command)
    taken, again, refused_one = answers
    assert taken.taken
    assert again == taken
    assert not refused_one.taken
    assert "association.gate" in refused_one.reason
    (event,) = messages(path, keys.EVENT, Event)
    assert (event.kind, event.carrier, event.step) == ("suspend", "bravo", taken.step)
    states = {c.step: c.state for c in messages(path, keys.CORRECTION, Correction)}
    assert states[event.step - 1] == "applied"
    assert {state for step, state in states.items() if step >= event.step} == {"suspended"}
    assert outputs(path) == refused(path)
