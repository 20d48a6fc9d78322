"""An operator suspends a correction in mid-run: an event, recorded, and fused again alike."""

from __future__ import annotations

from pathlib import Path

from crossfix.replaying.conducting import World, world_boot
from crossfix.replaying.speaking import Speaker
from schemas import codec, keys
from schemas.bus.member import Buses, Member
from schemas.bus.memory_bus import MemoryNetwork
from schemas.messages import Answer, Command, Correction, Event
from schemas.recording.reader import open_recording
from sim_world.scenario import Scenario, parse_scenario
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


def test_a_replay_into_a_fusion_centre_repeats_what_operators_did(tmp_path: Path) -> None:
    path, again = tmp_path / "run.mcap", tmp_path / "again.mcap"
    scenario = parse_scenario(SCENARIO.read_text(), SCENARIO.name)

    def command(run: MemoryRun) -> None:
        run.await_step(10)
        assert ask(run, Command(id="one", kind="suspend", carrier="bravo")).taken
        gate = Command(id="two", kind="set", setting="association.gate", value=12.0)
        assert ask(run, gate).taken
        run.await_step(18)
        assert ask(run, Command(id="three", kind="resume", carrier="bravo")).taken

    with MemoryNetwork() as network:
        run = MemoryRun(scenario, network, path)
        run.fusion_delay_s = 0.02
        run.carry_out(command)
    with MemoryNetwork(1, loss=0.1, delay_s=(0.0, 0.01)) as network:
        replayed(path, scenario, network, again)
    first, second = (list(messages(one, keys.EVENT, Event)) for one in (path, again))
    assert [event.id for event in first] == ["one", "two", "three"]
    assert first == second
    assert outputs(again) == outputs(path)
    assert refused(again) == outputs(path)


def replayed(path: Path, scenario: Scenario, network: MemoryNetwork, output: Path) -> None:
    """A recording replayed as the world of a fusion centre, which records it once more."""
    centre = MemoryRun(scenario, network, output)
    buses = Buses(network.bus("player"), network.bus("player"))
    with open_recording(path) as recording, Member(centre.run, keys.WORLD, buses) as member:
        member.boot = world_boot(recording)
        member.outbox.begin(member.boot)
        speaker = Speaker(buses.data, centre.run)
        world = World(member, recording, speaker)
        fusing = centre.start_fusion()
        with world.present(10.0):
            for message in recording.messages(roles=(keys.Role.INPUT, keys.Role.TRUTH)):
                world(message)
        fusing.join(20.0)
        assert not fusing.is_alive()
    assert not centre.errors
