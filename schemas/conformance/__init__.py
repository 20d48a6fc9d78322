"""Is a publisher as it should be? For its author: `crossfix check`, or a test of his own.

class TestMyPublisher(ConformanceTests):
    def samples(self) -> Iterable[Sample]:
        return everything_my_publisher_sends()
"""

from .checker import Conformance
from .findings import CODES, Finding
from .listening import Listener
from .mixin import ConformanceTests
from .residuals import SigmaCheck

__all__ = ["CODES", "Conformance", "ConformanceTests", "Finding", "Listener", "SigmaCheck"]
