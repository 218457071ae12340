"""The tuned numbers of networks that know the design: what each means, and why it has this value."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NetworkSettings:
    """How motions are sampled and networks are trained."""

    # Crank angles of the settled revolution at which a motion is taken, evenly apart. The RMS of the angle's error
    # over them differs from that over ten times as many by less than a thousandth
    points: int = 180
    # Of the crank angle, each with sine and cosine, fewer than half of `points`. Journals cross a clearance within
    # some degrees: with 24 harmonics a quarter of the spread of the lift is lost, with 60 a hundredth
    harmonics: int = 60
    # [1] Of the square of the lift's error beside those of the vectors' components: the lift is what the
    # transmission angle hangs on, and a difference of two components
    lift_weight: float = 1.0
    history: int = 20  # Steps that L-BFGS remembers; with more of them a step takes longer than it gains
    steps_at_once: int = 5  # Steps between two looks at the clock: some tenths of a second
    # [1] Size of the output layer's first weights as a share of the usual: the training begins near the mean motion
    first_outputs: float = 0.1


SETTINGS = NetworkSettings()
