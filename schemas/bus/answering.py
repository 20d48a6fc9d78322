"""How a handler's replies leave a process, on every bus alike."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import msgspec

from .. import codec
from ..errors import CrossfixError, WireError
from .interface import Handler, Sample
from .key_expressions import intersects
from .limits import require_size

_LOG = logging.getLogger(__name__)


def reply_to(question: Sample, message: msgspec.Struct) -> Sample:
    """A message as the reply to a question, in the question's own form: JSON for JSON."""
    if "json" in question.encoding:
        encoding = codec.encoding_of(type(message), "json")
        return Sample(question.key, codec.encode_json(message), encoding)
    return Sample(question.key, codec.encode(message), codec.encoding_of(type(message)))


def answers(handler: Handler, question: Sample) -> Iterator[Sample]:
    """The replies to one query, until one that cannot be sent.

    What the handler raises ends this answer and is logged: one question, which may hold anything,
    must not end the service of all others.
    """
    key = question.key
    try:
        for reply in handler(question):
            require_size(reply.key, reply.payload)
            if not intersects(reply.key, key):
                raise WireError("reply under a key not asked for", where=key, got=reply.key)
            yield reply
    except CrossfixError as error:
        _LOG.warning("query for %s refused: %s", key, error)
    except Exception:
        _LOG.exception("query for %s not answered", key)
