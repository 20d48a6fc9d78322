"""Tables of features: what a sensor tells of targets beside their place, and how it truly errs."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from schemas.messages.values import Id, Share, Text

from .table import Interval, Table

FeatureSigma = Annotated[float, Meta(gt=0, le=1e12)]


class FeatureErrors(Table, frozen=True, kw_only=True):
    """How a sensor truly measures a feature; what is absent is as declared.

    Attributes:
        wrong: share of its values that have nothing to do with their target; they are drawn from
            the population, without which there are none.
    """

    sigma: FeatureSigma | None = None
    wrong: Share = 0.0


class FeatureReports(Table, frozen=True, kw_only=True):
    """A number that a sensor measures of targets.

    Attributes:
        sigma: as declared.
        population: least and greatest value; false alarms are drawn from it.
        share: of the logs that bring it.
    """

    name: Id
    kind: Literal["parametric", "behavioural"] = "parametric"
    unit: Text = ""
    sigma: FeatureSigma
    population: Interval | None = None
    share: Share = 1.0
    errors: FeatureErrors = FeatureErrors()


class WordErrors(Table, frozen=True, kw_only=True):
    """How a sensor truly tells a word; what is absent is as declared."""

    accuracy: Share | None = None


class WordReports(Table, frozen=True, kw_only=True):
    """A word that a sensor tells of targets: the right one with `accuracy`, else any other.

    Attributes:
        categories: the words; false alarms show any of them.
        accuracy: as declared.
        share: of the logs that bring it.
    """

    name: Id
    kind: Literal["parametric", "behavioural"] = "behavioural"
    categories: Annotated[list[Text], Meta(min_length=2, max_length=64)]
    accuracy: Share
    share: Share = 1.0
    errors: WordErrors = WordErrors()
