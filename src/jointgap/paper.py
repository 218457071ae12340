"""What Erkaya & Uzmay (2009) print, as far as results are held against it."""

from dataclasses import dataclass

TRAINING_MSE = {
    "r2": 1.1980e-5,
    "r3": 7.6899e-6,
    "gamma2": 3.918e-7,
    "gamma3": 3.3382e-7,
    "gamma2_dot": 4.6977e-6,
    "gamma3_dot": 1.3006e-6,
    "gamma2_ddot": 2.5555e-5,
    "gamma3_ddot": 1.1352e-6,
}
"""Mean square error of each network after training, on data normalised to [0, 1] (text beside figure 8)."""

TRAINING_ITERATIONS = 20_000


@dataclass(frozen=True)
class PrintedOptimum:
    """One optimum of the paper: lengths in m, reduction as a fraction, evaluations (None: not printed)."""

    key: str
    name: str
    crank_length: float
    rod_length: float
    reduction: float
    evaluations: int | None


OPTIMA = (
    PrintedOptimum("printed_genetic", "genetic algorithm", 0.149465, 0.563196, 0.14980, 32),
    PrintedOptimum("printed_local", "local, best start", 0.149170, 0.562083, 0.14804, 17),
    PrintedOptimum("printed_local_other", "local, another start", 0.147287, 0.555001, 0.13716, None),
)

UNSTABLE_UNTIL_DEG = 30.0
ROD_DEVIATION_M = 0.001
PISTON_DEVIATION_M = 0.002
