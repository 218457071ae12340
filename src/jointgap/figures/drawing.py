"""What a figure function hands back."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure


@dataclass(frozen=True)
class Drawing:
    """A figure, or the frames of an animation, and the data that it shows.

    Attributes
    ----------
    figure : Figure
        The figure; of an animation, the state of the last frame.
    data : DataFrame
        Table `jointgap.tables.PLOTTED`.
    frames : tuple of ndarray
        Frames of an animation, shape (height, width, 3), uint8; empty for a still figure.
    frame_duration : float
        Time a frame is shown [s]; 0 for a still figure.
    """

    figure: Figure
    data: pd.DataFrame
    frames: tuple[np.ndarray, ...] = ()
    frame_duration: float = 0.0
