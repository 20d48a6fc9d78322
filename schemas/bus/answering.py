"""How a handler's replies leave a process, on every bus alike."""

from __future__ import annotations

import logging
from collections.abc import Iterator

from ..errors import CrossfixError, WireError
from .interface import Handler, Sample
from .key_expressions import intersects
from .limits import require_size

_LOG = logging.getLogger(__name__)


def answers(handler: Handler, key: str, question: bytes) -> Iterator[Sample]:
    """The replies to one query, until one that cannot be sent.

    What the handler raises ends this answer and is logged: one question, which may hold anything,
    must not end the service of all others.
    """
    try:
        for reply in handler(key, question):
            require_size(reply.key, reply.payload)
            if not intersects(reply.key, key):
                raise WireError("reply under a key not asked for", where=key, got=reply.key)
            yield reply
    except CrossfixError as error:
        _LOG.warning("query for %s refused: %s", key, error)
    except Exception:
        _LOG.exception("query for %s not answered", key)
