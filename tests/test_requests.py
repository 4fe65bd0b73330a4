"""Requests at random to the servers of pages: none is answered with what it may not see, and none brings one down."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from fuzz.campaign import scratch
from fuzz.requests import MOST_BODY_BYTES
from fuzz.servers import Target, targets

FEW = 250
NAMES = ("pomona view", "pomona watch", "pomona app")


@pytest.fixture(scope="module")
def servers() -> Iterator[dict[str, Target]]:
    with scratch() as folder, targets(folder) as found:
        yield {target.name: target for target in found}


@pytest.mark.parametrize("name", NAMES)
def test_requests_at_random_are_answered_or_refused(servers: dict[str, Target], name: str) -> None:
    tally = servers[name].try_requests(range(FEW))
    assert tally.findings == []
    assert tally.requests == FEW
    assert tally.most_read <= MOST_BODY_BYTES
    assert tally.statuses[200] > FEW / 10
    assert sum(count for status, count in tally.statuses.items() if status >= 400) > FEW / 10
