"""Channels held against the ideal motion before anything is fitted: sign, scale, phase, columns swapped, times.

Every channel's low orders over the crank angle are compared with those of rigid links without clearance: what the
geometry makes of positions, speeds and accelerations, and inverse dynamics of torque and forces. Loads, friction and
clearance change accelerations' low orders hardly, and forces by no more than inertia where the crank turns fast; so
forces are doubted only for what no load does alike in runs at speeds far apart."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from math import degrees, log, pi, tau
from typing import NamedTuple

import numpy as np
from scipy.signal import butter

from jointgap.config.campaign import CHANNELS, FILTER_ORDER, UNITS, Campaign, CampaignRun, Channel
from jointgap.core.units import unit_factor
from jointgap.dynamics.kinematics import FORCES, SPEED_POWERS, ideal_orders
from jointgap.rig.checks import cycle_scatter
from jointgap.rig.recording import Contradiction, Recording

MAX_ORDER = 4  # Orders of the crank that are held against the ideal motion
MIN_CORRELATION, MIN_CORRELATION_OF_FORCES = 0.9, 0.8  # From these on a factor between two channels means something
GAINS, GAINS_OF_FORCES = (0.8, 1.25), (0.5, 2.0)  # Factors that a sensor's gain or a load may make
ALIKE = 1.35  # Ratio up to which factors of several runs are one, and from which speeds are far apart
SEARCHED_TURNS = 20.0  # Turns in which a speed is searched for
REPEATING_SHARE = 0.7  # Share of its variance from which on a channel repeats with the crank
_PHASES = np.arange(-180, 180) * (pi / 180)
_REFERENCE = "what the mechanism makes of the crank's motion"


@dataclass(frozen=True)
class Orders:
    """Low orders of a channel in one run: channel [SI] = Re sum C_k exp(i k angle)."""

    measured: np.ndarray
    expected: np.ndarray
    error: float  # [SI] Standard error of the measured orders' norm

    @property
    def factor(self) -> float:
        """Size of the measured orders over that of those expected."""
        return float(np.linalg.norm(self.measured) / np.linalg.norm(self.expected))

    def shifted(self, phase: float) -> "Orders":
        """The same with the expected motion ahead by `phase` [rad]."""
        return replace(self, expected=self.expected * np.exp(1j * phase * np.arange(1, self.expected.size + 1)))

    @property
    def correlation(self) -> float:
        """Cosine between measured and expected orders; NaN where nothing is expected or measured."""
        size = np.linalg.norm(self.measured) * np.linalg.norm(self.expected)
        return float(np.real(np.vdot(self.expected, self.measured)) / size) if size else np.nan

    def misfit(self, scale: float = 1.0) -> float:
        """Distance of `scale` times the measured orders from those expected, over the size of these."""
        return float(np.linalg.norm(scale * self.measured - self.expected) / np.linalg.norm(self.expected))

    def is_clear(self, share: float) -> bool:
        """Whether noise is below a `share` of what is measured or expected."""
        return self.error < share * max(np.linalg.norm(self.measured), np.linalg.norm(self.expected))


class _Crank(NamedTuple):
    """How the crank turns in one run, with the sign of the file."""

    angle: np.ndarray  # [rad]
    speed: float  # [rad/s]
    clock: tuple[Contradiction, ...] = ()  # Doubts of the times


class _Rig(NamedTuple):
    """What the checks compare."""

    campaign: Campaign
    recordings: Mapping[str, Recording]
    cranks: dict[str, _Crank]  # Of the runs whose crank turns steadily at a known speed
    orders: dict[str, dict[str, Orders]]  # By run and channel

    def of_channel(self, channel: str) -> dict[str, Orders]:
        return {run: own[channel] for run, own in self.orders.items() if channel in own}


def contradictions(campaign: Campaign, recordings: Mapping[str, Recording]) -> list[Contradiction]:
    """What channels contradict each other, or the mechanism's ideal motion."""
    runs = [run for run in campaign.runs if run.id in recordings]
    found = {run.id: _crank(campaign, run, recordings[run.id]) for run in runs}
    cranks = {run: crank for run, crank in found.items() if crank is not None}
    orders = {run: _orders(campaign, recordings[run], crank.angle, crank.speed) for run, crank in cranks.items()}
    rig = _Rig(campaign, recordings, cranks, orders)
    zeros = _encoder_zeros(rig) if "crank_angle" in campaign.channels else {}
    # what is ahead by the encoder's offset in the mechanism is read at a larger angle
    shifted = {run: {c: o.shifted(-zeros.get(run, 0.0)) for c, o in own.items()} for run, own in orders.items()}
    swapped = _swapped(rig._replace(orders=shifted))
    taken = {one.channel for one in swapped}
    strays = [stray for stray in _strays(rig) if stray.channel not in taken]
    of_other_runs = {(stray.run, stray.channel) for stray in strays}
    left = {
        run: {c: o for c, o in own.items() if c not in taken and (run, c) not in of_other_runs}
        for run, own in shifted.items()
    }
    return [
        *(doubt for crank in cranks.values() for doubt in crank.clock),
        *(doubt for run in runs for doubt in _crank_speed(campaign, run, recordings[run.id])),
        *_doubts_of_zeros(rig, zeros),
        *swapped,
        *strays,
        *(doubt for channel in campaign.channels for doubt in _of_channel(rig._replace(orders=left), channel)),
    ]


def _crank(campaign: Campaign, run: CampaignRun, recording: Recording) -> _Crank | None:
    """How the crank turns; None where it is not known, or not steady."""
    sign = -1.0 if run.direction == "clockwise" else 1.0
    if not recording.has_angle:
        return _crank_without_encoder(campaign, run, recording, sign)
    angle = sign * recording.crank_angle
    if not recording.has_time:
        return _Crank(angle, sign * run.speed)
    finite = np.isfinite(angle)
    time, turned = recording.time[finite], np.abs(angle[finite] - angle[finite][0])
    speed = turned[-1] / (time[-1] - time[0])
    quarter = np.interp(time + tau / 4 / speed, time, turned) - turned
    if np.std(quarter[time + tau / 4 / speed <= time[-1]]) > 0.15 * tau / 4:
        return None
    return _timed(campaign, run, recording, _Crank(angle, sign * speed))


def _timed(campaign: Campaign, run: CampaignRun, recording: Recording, crank: _Crank) -> _Crank:
    """The crank with a doubt of the times or of the stated speed, where both are more than 10 % apart, and at the
    speed which the other channels bear out.

    Where times and crank angles are measured the stated speed is of no use, and the times are in doubt only where
    other channels say so.
    """
    ratio = log(abs(crank.speed) / run.speed)
    if campaign.drive != "constant_speed" or abs(ratio) < log(1.1):
        return crank
    orders = _orders(campaign, recording, crank.angle, crank.speed)
    rates = {c: o for c, o in orders.items() if SPEED_POWERS[c] and abs(o.correlation) > 0.5}
    rates = {c: o for c, o in rates.items() if c not in FORCES} or rates
    # a rate that is as large as it is at the stated speed says that the times are wrong
    votes = [-log(own.factor) / (SPEED_POWERS[channel] * ratio) for channel, own in rates.items()]
    kind = "time" if not votes or np.median(votes) > 0.5 else "speed"
    which = "either may be wrong"
    if votes:
        which = {
            "time": "the other channels are as large as at the stated speed, so the times are wrong",
            "speed": "the other channels are as large as at that one, so the stated speed is wrong",
        }[kind]
    source = "with crank_angle" if recording.has_angle else f"by what repeats in {', '.join(orders)}"
    sentence = (
        f"the times of the file make {60 * abs(crank.speed) / tau:.4g} rpm {source}, but the run's speed is "
        f"{60 * run.speed / tau:.4g} rpm; {which}"
    )
    doubtful = not recording.has_angle or (kind == "time" and bool(votes))
    doubt = Contradiction(run.id, "time", kind, sentence, factor=abs(crank.speed) / run.speed, doubtful=doubtful)
    speed = np.copysign(run.speed, crank.speed) if kind == "time" else crank.speed
    return _Crank(crank.angle, float(speed), (doubt,))


def _crank_without_encoder(campaign: Campaign, run: CampaignRun, recording: Recording, sign: float) -> _Crank | None:
    """It turns at the stated speed, unless channels agree much better with the ideal motion at another one."""
    if campaign.drive != "constant_speed":
        return None
    stated, elapsed = sign * run.speed, recording.time - recording.time[0]
    nominal, first = _agreement(campaign, recording, elapsed, stated)
    found = _speed_that_agrees(campaign, recording, elapsed, stated) if nominal <= 0.6 else None
    if found is None or found[1] < 0.5 or nominal > 0.6 * found[1]:
        return _Crank(stated * elapsed + first, stated)
    ratio, _, first = found
    return _timed(campaign, run, recording, _Crank(stated * ratio * elapsed + first, stated * ratio))


def _agreement(campaign: Campaign, recording: Recording, elapsed: np.ndarray, speed: float) -> tuple[float, float]:
    """Mean share of the variance that the ideal motion at a `speed` [rad/s] explains at the best first angle, and that
    angle [rad]; of the channels that follow from the geometry where there are any, for loads change the others.

    `elapsed` (n,) [s] may be NaN where samples are left out.
    """
    orders = _orders(campaign, recording, speed * elapsed, speed)
    orders = {name: own for name, own in orders.items() if name not in FORCES} or orders
    if not orders:
        return 0.0, 0.0
    phases = np.arange(180) * (tau / 180)
    scores = np.zeros(phases.size)
    for name, own in orders.items():
        turning = np.exp(-1j * np.outer(phases, np.arange(1, own.expected.size + 1)))
        projected = np.real(turning @ (own.expected.conj() * own.measured)) / np.linalg.norm(own.expected)
        variance = float(np.nanvar(recording.channels[name][np.isfinite(elapsed)]))
        scores += np.maximum(projected, 0.0) ** 2 / (2.0 * variance) / len(orders)
    best = int(np.argmax(scores))
    return float(scores[best]), float(phases[best])


def _speed_that_agrees(
    campaign: Campaign, recording: Recording, elapsed: np.ndarray, stated: float
) -> tuple[float, float, float] | None:
    """Ratio of the speed at which the channels agree best to the `stated` one [rad/s], and `_agreement` there.

    The first turns are searched through, longer parts only about what these give. None where there is nothing to
    compare. Of forces alone no ratio is taken at which their strongest order is a whole one at the stated speed, where
    a load has its orders.
    """
    shape = _orders(campaign, recording, stated * elapsed, stated)
    if not shape:
        return None
    forces_alone = all(name in FORCES for name in shape)
    strongest = [1 + int(np.argmax(np.abs(own.expected))) for own in shape.values()] if forces_alone else []
    total = abs(stated) * float(elapsed[-1]) / tau
    turns = min(total, SEARCHED_TURNS)
    low, high = 0.53, 1.9
    while True:
        part = np.where(elapsed <= turns * tau / abs(stated), elapsed, np.nan)
        ratios = np.geomspace(low, high, int(np.log(high / low) * 6.0 * turns) + 2)
        for order in strongest:
            ratios = ratios[np.abs(order * ratios - np.round(order * ratios)) > 0.15]
        if not ratios.size:
            return None
        (score, first), ratio = max(
            ((_agreement(campaign, recording, part, stated * ratio), ratio) for ratio in ratios),
            key=lambda tried: tried[0][0],
        )
        if turns >= total:
            return float(ratio), score, first
        low, high = ratio * np.exp(np.array([-0.5, 0.5]) / turns)
        turns = min(4.0 * turns, total)


def _orders(campaign: Campaign, recording: Recording, angle: np.ndarray, speed: float) -> dict[str, Orders]:
    """`Orders` of the channels of a run whose crank is at `angle` (n,) [rad] at a mean `speed` [rad/s].

    Of forces only where no load but gravity is known, and the crank's own inertia takes no torque.
    """
    finite = angle[np.isfinite(angle)]
    per_turn = finite.size * tau / abs(finite[-1] - finite[0])
    count = int(np.clip(per_turn / 4, 1, MAX_ORDER))
    loaded = any(effect.name != "gravity" for effect in campaign.mechanism.effects)
    expected = ideal_orders(campaign.mechanism, speed, count)
    columns, orders = _harmonics(angle, count), {}
    for name, values in recording.channels.items():
        if name not in expected or (name in FORCES and (loaded or campaign.drive != "constant_speed")):
            continue
        measured, error = _low_orders(columns, values, per_turn)
        filtered = expected[name] * _response(campaign.channels[name], speed * np.arange(1, count + 1))
        if np.linalg.norm(filtered) > 0.0 and np.isfinite(error):
            orders[name] = Orders(measured, filtered, error)
    return orders


def _response(channel: Channel, frequencies: np.ndarray) -> np.ndarray:
    """Complex factors (k,) of the low-pass that a channel's samples went through at `frequencies` (k,) [rad/s]."""
    if channel.bandwidth is None:
        return np.ones(frequencies.size)
    top, bottom = butter(FILTER_ORDER, tau * channel.bandwidth, analog=True)
    response = np.polyval(top, 1j * frequencies) / np.polyval(bottom, 1j * frequencies)
    return response if channel.filter == "causal" else np.abs(response) ** 2


def _low_orders(columns: np.ndarray, values: np.ndarray, per_turn: float) -> tuple[np.ndarray, float]:
    """Complex orders (k,) of `values` (n,) by regression, and the standard error of their norm.

    What the low orders leave may come back every turn, so no more samples count than the `per_turn` of a turn.
    """
    count = columns.shape[1] // 2
    finite = np.isfinite(columns[:, 1]) & np.isfinite(values)
    columns, values = columns[finite], values[finite]
    if values.size < 4 * count + 4:
        return np.zeros(count, complex), np.inf
    solution = np.linalg.lstsq(columns.T @ columns, columns.T @ values, rcond=None)[0]
    error = float(np.std(values - columns @ solution) * np.sqrt(4.0 * count / min(per_turn, values.size)))
    return solution[1 : count + 1] - 1j * solution[count + 1 :], error


def _harmonics(angle: np.ndarray, count: int) -> np.ndarray:
    """Regressors (n, 1 + 2 count): a constant, cosines and sines of the multiples of the `angle` (n,) [rad]."""
    turning = np.exp(1j * angle)[:, None] ** np.arange(1, count + 1)
    return np.column_stack([np.ones(angle.size), turning.real, turning.imag])


def _crank_speed(campaign: Campaign, run: CampaignRun, recording: Recording) -> list[Contradiction]:
    """Whether a channel of the crank's speed is the rate of its angle, or else near the run's speed, on the mean."""
    if "crank_speed" not in recording.channels:
        return []
    speed, source = (-1.0 if run.direction == "clockwise" else 1.0) * run.speed, "the speed of the run"
    if recording.has_angle and recording.has_time:
        ends = np.flatnonzero(np.isfinite(recording.crank_angle))[[0, -1]]
        speed = np.copysign(1.0, speed) * np.ptp(recording.crank_angle[ends]) / np.ptp(recording.time[ends])
        source = "the rate of crank_angle"
    factor = float(np.nanmean(recording.channels["crank_speed"])) / speed
    low, high = GAINS
    if -1.0 / low < factor < -low:
        sentence = _sign_sentence(campaign, "crank_speed", source)
        return [Contradiction(run.id, "crank_speed", "sign", sentence, factor=factor)]
    if low < factor < high or (campaign.drive == "motor" and not recording.has_angle):
        return []
    sentence = _scale_sentence(campaign, "crank_speed", factor, source)
    return [Contradiction(run.id, "crank_speed", "scale", sentence, factor=factor)]


def _encoder_zeros(rig: _Rig) -> dict[str, float]:
    """By how much [rad] the encoder of each run reads too much, where that is far: one amount in all, or each its own.

    One channel that is off in one run alone is no evidence of the encoder, unless its zero is listed as not known.
    """
    if common := _common_phase(rig.orders):
        return dict.fromkeys(rig.orders, common)
    least = 1 if "encoder_zero" in rig.campaign.nuisance else 2
    several = {run: own for run, own in rig.orders.items() if sum(name not in FORCES for name in own) >= least}
    zeros = {run: _common_phase({run: own}) for run, own in several.items()}
    return {run: zero for run, zero in zeros.items() if zero}


def _common_phase(orders: Mapping[str, Mapping[str, Orders]]) -> float:
    """Offset [rad] of the encoder's reading at which all channels of all runs follow, where they do not without; or 0.

    Forces are asked only where there is no other channel.
    """
    series = [(name, own) for each in orders.values() for name, own in each.items() if own.is_clear(0.3)]
    geometric = [own for name, own in series if name not in FORCES]
    asked, least = geometric, MIN_CORRELATION
    if not geometric:
        by_channel = {name: [own for other, own in series if other == name] for name, _ in series}
        if not all(map(_no_load_does, by_channel.values())):
            return 0.0
        asked, least = [own for _, own in series], MIN_CORRELATION_OF_FORCES
    if not asked or any(own.correlation > least for own in asked):
        return 0.0
    agreement = np.array([[own.shifted(-phase).correlation for own in asked] for phase in _PHASES])
    best = int(np.argmax(agreement.sum(axis=1)))
    if agreement[best].min() < least or abs(_PHASES[best]) < 0.5:  # less is left to the analysis, which names it
        return 0.0
    # one channel of the opposite sign or of another kind is no evidence of the encoder
    flipped = [min(own.misfit(1.0 / own.factor), own.misfit(-1.0 / own.factor)) for own in asked]
    turned = [own.shifted(-_PHASES[best]).misfit(1.0 / own.factor) for own in asked]
    return float(_PHASES[best]) if np.mean(turned) < 0.7 * np.mean(flipped) else 0.0


def _no_load_does(runs: list[Orders]) -> bool:
    """Whether a force is about as large as expected in runs at speeds at which loads are not.

    What is expected grows with the square of the speed.
    """
    factors = [own.factor for own in runs]
    expected = [float(np.linalg.norm(own.expected)) for own in runs]
    usual = GAINS_OF_FORCES[0] < min(factors) and max(factors) < GAINS_OF_FORCES[1]
    return usual and max(factors) <= ALIKE * min(factors) and np.sqrt(max(expected) / min(expected)) >= ALIKE


def _doubts_of_zeros(rig: _Rig, zeros: Mapping[str, float]) -> list[Contradiction]:
    """Doubts of the encoder's zero [rad], by run, beyond the bounds that are listed for it."""
    low, high = rig.campaign.nuisance.get("encoder_zero", (0.0, 0.0))
    step = pi / 180  # of the zeros that are tried
    found = []
    for run, zero in zeros.items():
        if low - step < zero < high + step:
            continue
        channels = sorted({channel for other in zeros if zeros[other] == zero for channel in rig.orders[other]})
        sentence = (
            f"the zero of crank_angle is off: {', '.join(channels)} follow from the mechanism if it reads "
            f"{degrees(zero):.0f} deg too much; correct it, or see whether encoder_offset is named"
        )
        found.append(Contradiction(run, "crank_angle", "phase", sentence, phase=zero))
    return found


def _swapped(rig: _Rig) -> list[Contradiction]:
    """Pairs of channels each of which is what the other is said to be.

    Both have to be off by 15 % of what is expected, and by less with their columns exchanged; of forces loads are left.
    """
    names = [name for name in rig.campaign.channels if rig.of_channel(name)]
    candidates = []
    for first, second in combinations(names, 2):
        runs = [run for run, own in rig.orders.items() if first in own and second in own]
        # the columns were read in each other's unit
        scale = rig.campaign.factor(second) / rig.campaign.factor(first)
        as_is, exchanged, limits = [], [], []
        for channel, other, factor in ((first, second, 1.0 / scale), (second, first, scale)):
            pairs = [(rig.orders[run][channel], rig.orders[run][other]) for run in runs]
            as_is.append(np.median([own.misfit() for own, _ in pairs]))
            exchanged.append(np.median([replace(own, measured=one.measured).misfit(factor) for own, one in pairs]))
            limits.append(0.7 if channel in FORCES else 0.15)
        gain = sum(exchanged) / sum(as_is)
        enough = min(as_is) > 0.15 and all(left < limit for left, limit in zip(exchanged, limits, strict=True))
        if enough and gain < (0.5 if 0.7 in limits else 0.3):
            candidates.append((gain, first, second, runs))
    found, taken = [], set()
    for _, first, second, runs in sorted(candidates):
        if taken & {first, second}:
            continue
        taken |= {first, second}
        columns = (rig.campaign.channels[first].column, rig.campaign.channels[second].column)
        sentence = (
            f"{first} and {second} are swapped: column {columns[0]} is what the mechanism makes of {second}, "
            f"and column {columns[1]} of {first}; exchange the two columns in the campaign file"
        )
        for channel, other in ((first, second), (second, first)):
            found += [Contradiction(run, channel, "swapped", sentence, other) for run in runs]
    return found


def _strays(rig: _Rig) -> list[Contradiction]:
    """Channels that repeat with the crank in all runs but one, and in that one at another speed or as another run."""
    repeats = {
        run: {name: _repeats(crank.angle, values) for name, values in rig.recordings[run].channels.items()}
        for run, crank in rig.cranks.items()
    }
    found = []
    for run, own in repeats.items():
        for name, value in own.items():
            others = [shares[name] for other, shares in repeats.items() if other != run]
            strange = value < 0.5 and min(others, default=0.0) > REPEATING_SHARE
            if strange and max(own.values()) >= REPEATING_SHARE and _is_of_another(rig, run, name):
                sentence = f"{name} does not repeat with the crank as in the other runs; is it from another run's file?"
                found.append(Contradiction(run, name, "unrelated", sentence))
    return found


def _is_of_another(rig: _Rig, run: str, name: str) -> bool:
    """Whether a channel of a run has another run's samples, or repeats at another speed than the run's crank.

    Noise and impacts, which do not repeat with the crank either, do neither.
    """
    values, angle = rig.recordings[run].channels[name], rig.cranks[run].angle
    for other, recording in rig.recordings.items():
        count = min(values.size, recording.channels[name].size)
        both = np.column_stack([values[:count], recording.channels[name][:count]])
        both = both[np.isfinite(both).all(axis=1)]
        if other != run and len(both) > 12 and np.corrcoef(both.T)[0, 1] > 0.99:
            return True
    turned = np.abs(_bridged(angle) - angle[np.isfinite(angle)][0])
    part = turned <= SEARCHED_TURNS * tau
    turned, values = turned[part], values[part]
    turns, variance = turned[-1] / tau, float(np.nanvar(values))
    low, high = 2.0 / turns, turned.size / turns / (4.0 * MAX_ORDER)  # to be told by it, it repeats twice
    for ratio in np.geomspace(low, high, int(np.log(high / low) * 6.0 * turns * high) + 2) if high > low else ():
        error = _low_orders(_harmonics(ratio * turned, MAX_ORDER), values, 1.0)[1]
        if 1.0 - error**2 / (4.0 * MAX_ORDER) / variance > REPEATING_SHARE:
            return True
    return False


def _bridged(angle: np.ndarray) -> np.ndarray:
    """Crank angle (n,) [rad] without gaps."""
    finite = np.flatnonzero(np.isfinite(angle))
    return np.interp(np.arange(angle.size), finite, angle[finite])


def _repeats(angle: np.ndarray, values: np.ndarray) -> float:
    """Share of the variance of `values` (n,) that comes back with the crank's `angle` (n,): low orders, or a turn on.

    The larger one: impacts have high orders, and few samples a turn cannot be compared with those of the next.
    """
    bridged = np.abs(_bridged(angle))
    per_turn = angle.size * tau / (bridged[-1] - bridged[0])
    columns = _harmonics(angle, int(np.clip(per_turn / 4, 1, MAX_ORDER)))
    left = _low_orders(columns, values, 1.0)[1] ** 2 / (2.0 * (columns.shape[1] - 1))
    scatter = cycle_scatter(bridged, values)
    return 1.0 - min(left, scatter**2 if np.isfinite(scatter) else left) / float(np.nanvar(values))


def _of_channel(rig: _Rig, channel: str) -> list[Contradiction]:
    """What is wrong with one channel, run by run; of forces only what is wrong in all runs alike."""
    clear = {run: own for run, own in rig.of_channel(channel).items() if own.is_clear(0.25)}
    if not clear:
        return []
    factors = [own.factor for own in clear.values()]
    alike, common = max(factors) < ALIKE * min(factors), float(np.median(factors))
    force = channel in FORCES
    least, gains = (MIN_CORRELATION_OF_FORCES, GAINS_OF_FORCES) if force else (MIN_CORRELATION, GAINS)
    if force:
        speeds = [abs(rig.cranks[run].speed) for run in clear]
        apart = max(speeds) / min(speeds)
        turned = all(own.correlation < -least for own in clear.values()) and gains[0] < common < gains[1]
        as_expected = all(own.correlation > least for own in clear.values())
        told = apart > ALIKE if turned else as_expected and apart > _speeds_apart(common)
        if not (alike and told):
            return []
    doubts = []
    for run, own in clear.items():
        factor, correlation, found = common if alike else own.factor, own.correlation, {"factor": own.factor}
        if correlation < -least:
            kind, sentence, found = "sign", _sign_sentence(rig.campaign, channel, _REFERENCE), {"factor": -own.factor}
        elif correlation > least:
            if gains[0] < factor < gains[1]:
                continue
            kind, sentence = "scale", _scale_sentence(rig.campaign, channel, factor, _REFERENCE)
            found = {"factor": factor}
        elif correlation >= 0.5 and own.factor * correlation >= 0.4:
            continue
        elif (phase := _own_phase(own)) is not None:
            kind, found = "phase", {"factor": own.factor, "phase": phase}
            sentence = f"{channel} is {degrees(phase):.0f} deg off {_REFERENCE}; check how it was synchronised"
        else:
            kind = "unrelated"
            sentence = (
                f"{channel} is not {_REFERENCE} (correlation {correlation:.2f}); check the columns, the sensor, and "
                "whether it is of this run"
            )
        doubts.append(Contradiction(run, channel, kind, sentence, **found))
    return doubts


def _speeds_apart(factor: float) -> float:
    """Ratio of speeds [1] at which a load that grows in proportion to them does not make forces `factor` times what is
    expected in all runs alike.

    Beside inertia, which grows with the square, it is the smaller the faster the run: the ratio of what it would have
    to be at factors that are still alike.
    """
    loads = abs(factor * np.sqrt(ALIKE) - 1.0), abs(factor / np.sqrt(ALIKE) - 1.0)
    return max(loads) / min(loads)


def _own_phase(own: Orders) -> float | None:
    """Shift [rad] by which one channel is what is expected; None where it is not at any."""
    agreement = [own.shifted(-phase).correlation for phase in _PHASES]
    best = int(np.argmax(agreement))
    return float(_PHASES[best]) if agreement[best] > 0.97 and GAINS[0] < own.factor < GAINS[1] else None


def _sign_sentence(campaign: Campaign, channel: str, reference: str) -> str:
    turned = campaign.channels[channel].sign == -1
    fix = "remove the channel's sign: -1" if turned else "give the channel sign: -1"
    return f"{channel} has the opposite sign of {reference}; check the sensor's direction, or {fix}"


def _scale_sentence(campaign: Campaign, channel: str, factor: float, reference: str) -> str:
    stated, own = campaign.channels[channel], campaign.factor(channel)
    sentence = f"{channel} is {factor:.4g} times {reference}; check "
    if stated.scale is not None:
        return f"{sentence}channels.{channel}.scale = '{stated.scale}'"
    sentence += "the units of both"
    for other in UNITS[CHANNELS[channel]]:
        if abs(factor * unit_factor(other, CHANNELS[channel]) / own - 1.0) < 0.05:
            return f"{sentence}: did you mean '{other}' by channels.{channel}.unit = '{stated.unit}'?"
    return sentence
