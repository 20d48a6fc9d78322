"""Keys: built and parsed by one table, strangers' ones refused."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas import keys
from schemas.errors import WireError

IDS = st.text("abcz09_-", min_size=1, max_size=32)
every_topic = pytest.mark.parametrize("topic", keys.TOPICS, ids=lambda t: t.name)


def names(topic: keys.Topic) -> list[str]:
    return re.findall(r"{(\w+)}", topic.template)


@every_topic
def test_what_is_built_is_parsed(topic: keys.Topic) -> None:
    @settings(max_examples=20, deadline=None)
    @given(IDS, st.tuples(*[IDS for _ in names(topic)]))
    def holds(run: str, ids: tuple[str, ...]) -> None:
        key = topic.key(run, *ids)
        assert keys.parse(key) == (run, topic, dict(zip(names(topic), ids, strict=True)))
        assert key.startswith(f"crossfix/@v1/{run}/")

    holds()


@every_topic
def test_a_key_lies_in_the_expressions_that_stand_for_it(topic: keys.Topic) -> None:
    key = topic.key("run", *(["fusion", "b"][: len(names(topic))]))
    for expression in (topic.every("run"), keys.everything("run")):
        chunks = expression.replace("**", "[^@]+").replace("*", "[^/@]+")
        assert re.fullmatch(chunks, key)
    assert not re.fullmatch(topic.every("run").replace("*", "[^/]+"), key.replace("run", "other"))


GOOD = "crossfix/@v1/strait/report/alpha/radar"


@pytest.mark.parametrize(
    "key",
    [
        "",
        GOOD + "\n",
        GOOD + " ",
        GOOD + "/",
        GOOD + "/extra",
        " " + GOOD,
        GOOD.replace("alpha", "*"),
        GOOD.replace("radar", "**"),
        GOOD.replace("radar", "$*"),
        GOOD.replace("alpha", "al pha"),
        GOOD.replace("alpha", "Alpha"),
        GOOD.replace("alpha", "a" * 33),
        GOOD.replace("alpha", ""),
        GOOD.replace("alpha", ".."),
        GOOD.replace("alpha", "алфа"),
        GOOD.replace("alpha", "a\x00b"),
        GOOD.replace("@v1", "@v2"),
        GOOD.replace("@v1", "v1"),
        GOOD.replace("report", "reports"),
        GOOD.replace("crossfix", "Crossfix"),
        "crossfix/@v1/strait/alive/alpha/b1",
        "crossfix/@v1/strait",
        GOOD * 100,
    ],
)
def test_what_is_no_key_of_this_protocol_is_refused(key: str) -> None:
    with pytest.raises(WireError):
        keys.parse(key)


@given(st.text(max_size=80))
def test_no_text_makes_parse_raise_anything_else(text: str) -> None:
    for key in (text, f"crossfix/@v1/{text}", f"crossfix/@v1/run/report/{text}"):
        try:
            address = keys.parse(key)
        except WireError:
            continue
        assert address.topic.key(address.run, *address.ids.values()) == key


@pytest.mark.parametrize("bad", ["", "A", "a b", "a/b", "*", "a\n", "a" * 33, "é", ".."])
def test_no_key_is_built_from_what_is_no_id(bad: str) -> None:
    with pytest.raises(WireError, match="not an id"):
        keys.NAVIGATION.key(bad, "alpha")
    with pytest.raises(WireError, match="not an id"):
        keys.NAVIGATION.key("run", bad)
    with pytest.raises(WireError, match="not an id"):
        keys.everything(bad)
    with pytest.raises(WireError, match="not an id"):
        keys.alive("run", bad, "b1")


def test_a_key_needs_the_ids_of_its_template() -> None:
    with pytest.raises(WireError, match="key of report"):
        keys.REPORT.key("run", "alpha")
    with pytest.raises(WireError, match="key of step"):
        keys.STEP.key("run", "alpha")


@given(IDS, IDS, IDS)
def test_liveliness_tokens_round_trip(run: str, process: str, boot: str) -> None:
    token = keys.alive(run, process, boot)
    assert keys.parse_alive(token) == (run, process, boot)
    for bad in (token + "\n", token + "/x", token.replace("@v1", "@v2"), token.upper()):
        with pytest.raises(WireError):
            keys.parse_alive(bad)


@pytest.mark.parametrize(
    ("key", "stream"),
    [
        (keys.SOURCE.key("run", "alpha", "radar"), "info"),
        (keys.REPORT.key("run", "alpha", "radar"), "radar"),
        (keys.NAVIGATION.key("run", "alpha"), "navigation"),
        (keys.RANGING.key("run", "alpha"), "ranging"),
        (keys.CORRECTION.key("run", "fusion", "alpha"), "correction/fusion/alpha"),
        (keys.TRUTH_TARGETS.key("run"), "truth/targets"),
    ],
)
def test_streams(key: str, stream: str) -> None:
    assert keys.stream(keys.parse(key)) == stream


def test_the_key_of_a_stream_leads_back_to_it() -> None:
    for topic in keys.TOPICS:
        ids = ["alpha"] * topic.template.count("{")
        address = keys.parse(topic.key("run", *ids))
        if topic is keys.SOURCE:
            assert keys.of_stream("run", "alpha", keys.stream(address)) is None
        elif "/" in keys.stream(address) or (topic.role is keys.Role.INPUT and ids):
            assert keys.of_stream("run", "alpha", keys.stream(address)) == topic.key("run", *ids)
