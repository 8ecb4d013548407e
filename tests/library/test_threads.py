"""How many threads of BLAS a tracker in another program uses."""

from __future__ import annotations

from collections.abc import Iterator

from threadpoolctl import threadpool_info, threadpool_limits  # type: ignore[import-untyped]

from gepf.tracker import with_one_blas_thread


def blas_threads() -> set[int]:
    """The numbers of threads of all BLAS libraries in this process."""
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_frames_are_computed_with_one_thread_and_the_caller_keeps_its_own() -> None:
    """Inside the loop it is one; between two frames, and after the last, as many as before."""

    def frames() -> Iterator[set[int]]:
        for _ in range(3):
            yield blas_threads()

    with threadpool_limits(2, "blas"):
        own, count = blas_threads(), 0
        assert 2 in own
        for inside in with_one_blas_thread(frames()):
            assert inside == {1}
            assert blas_threads() == own
            count += 1
        assert count == 3
        assert blas_threads() == own
