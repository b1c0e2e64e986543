"""How many examples a property is tried with: few and the same ones in every run, more and random ones when asked for.

``pytest --examples 10`` tries ten times as many, other ones in every run.
"""

import hypothesis

PLAIN = 50
"""Of a property that names no number."""
_times = 1


def chosen(times: int) -> None:
    """So many times the examples; to be called before a test module is imported."""
    global _times
    _times = times
    # a busy machine must not fail a property: no example has a time limit
    hypothesis.settings.register_profile(
        "landslope", deadline=None, max_examples=PLAIN * times, derandomize=times == 1
    )
    hypothesis.settings.load_profile("landslope")


def examples(count: int) -> hypothesis.settings:
    """The decorator of a property that is tried with ``count`` examples."""
    return hypothesis.settings(max_examples=count * _times)
