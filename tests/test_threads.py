"""Work shared out among threads: in order, no more of it begun than is soon asked for, errors at their turn."""

from __future__ import annotations

import threading

import pytest

from pomona.basics.threads import cores, in_order


def test_results_come_in_the_items_order_whoever_is_first() -> None:
    second_is_done = threading.Event()

    def work(k: int) -> int:
        if k == 0:
            assert second_is_done.wait(60), "the second item is begun while the first one is not done"
        if k == 1:
            second_is_done.set()
        return k * k

    assert list(in_order(work, range(20), 3)) == [k * k for k in range(20)]


def test_no_more_is_begun_than_is_soon_asked_for() -> None:
    begun: list[int] = []
    results = in_order(lambda k: begun.append(k) or k, iter(range(1000)), 2)
    assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
    results.close()
    assert set(begun) <= set(range(5 + 2))


def test_what_goes_wrong_is_raised_when_its_turn_comes() -> None:
    def work(k: int) -> int:
        if k == 2:
            raise ValueError("the third")
        return k

    results = in_order(work, range(5), 2)
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ValueError, match="the third"):
        next(results)


def test_what_was_begun_when_it_ends_is_finished_and_handed_over() -> None:
    begun, left = threading.Event(), list[int]()

    def work(k: int) -> int:
        if k == 0:
            assert begun.wait(60)
            raise ValueError("the first")
        begun.set()
        return k

    with pytest.raises(ValueError, match="the first"):
        list(in_order(work, range(9), 2, left=left.append))
    assert left[0] == 1
    assert left == sorted(left)
    assert left[-1] < 3


def test_nothing_to_do_is_nothing_done() -> None:
    assert list(in_order(lambda k: k, [], 4)) == []
    assert cores() >= 1
