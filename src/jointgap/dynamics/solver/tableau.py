"""Tableau of the 8th-order Runge-Kutta method of Dormand and Prince with its 5th- and 3rd-order error estimators.

Coefficients of DOP853 in Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, 2nd edition, section
II.10. Stage s is taken at `NODES[s]` with the weights `STAGES[s, :s]`; row COUNT of both is the end of the step.
"""

import numpy as np
from scipy.integrate import DOP853

COUNT = 12

NODES = np.array(
    [
        0.0,
        0.05260015195876773,
        0.0789002279381516,
        0.1183503419072274,
        0.2816496580927726,
        0.3333333333333333,
        0.25,
        0.3076923076923077,
        0.6512820512820513,
        0.6,
        0.8571428571428571,
        1.0,
        1.0,
    ]
)
"""Fraction of the step at each stage, and at its end."""

STAGES = np.zeros((COUNT + 1, COUNT))
"""Weights of the earlier stages in each stage; the last row is the solution, order 8."""

STAGES[1, 0] = 0.05260015195876773
STAGES[2, [0, 1]] = [
    0.0197250569845379,
    0.0591751709536137,
]
STAGES[3, [0, 2]] = [
    0.02958758547680685,
    0.08876275643042054,
]
STAGES[4, [0, 2, 3]] = [
    0.2413651341592667,
    -0.8845494793282861,
    0.924834003261792,
]
STAGES[5, [0, 3, 4]] = [
    0.037037037037037035,
    0.17082860872947386,
    0.12546768756682242,
]
STAGES[6, [0, 3, 4, 5]] = [
    0.037109375,
    0.17025221101954405,
    0.06021653898045596,
    -0.017578125,
]
STAGES[7, [0, 3, 4, 5, 6]] = [
    0.03709200011850479,
    0.17038392571223998,
    0.10726203044637328,
    -0.015319437748624402,
    0.008273789163814023,
]
STAGES[8, [0, 3, 4, 5, 6, 7]] = [
    0.6241109587160757,
    -3.3608926294469414,
    -0.868219346841726,
    27.59209969944671,
    20.154067550477894,
    -43.48988418106996,
]
STAGES[9, [0, 3, 4, 5, 6, 7, 8]] = [
    0.47766253643826434,
    -2.4881146199716677,
    -0.590290826836843,
    21.230051448181193,
    15.279233632882423,
    -33.28821096898486,
    -0.020331201708508627,
]
STAGES[10, [0, 3, 4, 5, 6, 7, 8, 9]] = [
    -0.9371424300859873,
    5.186372428844064,
    1.0914373489967295,
    -8.149787010746927,
    -18.52006565999696,
    22.739487099350505,
    2.4936055526796523,
    -3.0467644718982196,
]
STAGES[11, [0, 3, 4, 5, 6, 7, 8, 9, 10]] = [
    2.273310147516538,
    -10.53449546673725,
    -2.0008720582248625,
    -17.9589318631188,
    27.94888452941996,
    -2.8589982771350235,
    -8.87285693353063,
    12.360567175794303,
    0.6433927460157636,
]
STAGES[12, [0, 5, 6, 7, 8, 9, 10, 11]] = [
    0.054293734116568765,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    0.3111643669578199,
    -0.1521609496625161,
    0.20136540080403034,
    0.04471061572777259,
]

ERROR_5 = np.array(
    [
        0.01312004499419488,
        0.0,
        0.0,
        0.0,
        0.0,
        -1.2251564463762044,
        -0.4957589496572502,
        1.6643771824549864,
        -0.35032884874997366,
        0.3341791187130175,
        0.08192320648511571,
        -0.022355307863886294,
    ]
)
"""Weights of the stages in the difference to the 5th-order solution."""

ERROR_3 = np.array(
    [
        -0.18980075407240762,
        0.0,
        0.0,
        0.0,
        0.0,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        -0.4226823213237919,
        -0.1521609496625161,
        0.20136540080403034,
        0.02265179219836082,
    ]
)
"""Weights of the stages in the difference to the 3rd-order solution."""

KEPT = 16
"""Stages kept of a step: its own, the rates at its end, and three more from which the interpolant follows."""

MORE_STAGES, MORE_NODES, INTERPOLANT = (np.array(each) for each in (DOP853.A_EXTRA, DOP853.C_EXTRA, DOP853.D))
"""Weights (3, 16) and nodes (3,) of the three further stages; weights (4, 16) of all stages in the interpolant's upper
terms. Columns 1 to 4 are zero."""
