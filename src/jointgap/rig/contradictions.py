"""Channels held against the ideal motion before anything is fitted: sign, scale, phase, columns swapped, times.

Every channel's low orders over the crank angle are compared with those of rigid links without clearance: what the
geometry makes of positions, speeds and accelerations, and inverse dynamics of torque and forces. Loads, friction and
clearance change accelerations' low orders hardly, and forces by no more than inertia where the crank turns fast; so
forces are doubted only for what no load does alike in runs at speeds far apart."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, pi, tau

import numpy as np
from scipy.signal import butter

from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.config.channels import CHANNELS, FILTER_ORDER, UNITS, Channel
from jointgap.dynamics.kinematics import FORCES, SPEED_POWERS, ideal_orders
from jointgap.quantities import unit_factor
from jointgap.rig.inspection import cycle_scatter
from jointgap.rig.recording import Recording
from jointgap.rig.settings import DEFAULT_LIMITS, RecordingLimits

OF_SAMPLES = ("clipped", "stuck", "no_data")
"""Kinds of contradictions that are told by a channel's samples alone; no gain or zero of a sensor undoes them."""

OF_A_RUN = ("step", "standstill", "turns_back")
"""Kinds for which a run is left out: its crank angle steps and stays there, or the crank does not turn on."""


@dataclass(frozen=True)
class Contradiction:
    """What one channel of one run cannot be."""

    run: str  # ``time`` also where it may be the run's speed that is wrong
    channel: str  # ``time`` also where it may be the run's speed that is wrong
    kind: str  # sign, scale, phase, swapped, unrelated, one of `OF_SAMPLES` or of `OF_A_RUN`, time or speed
    remark: str  # In a sentence, without the place
    other: str = ""  # The channel that it is swapped with or held against; empty where there is none
    factor: float = np.nan  # [1] Measured over expected; NaN where there is none
    phase: float = np.nan  # [rad] By how much the channel is ahead of what is expected; NaN where there is none
    doubtful: bool = True  # Whether the channel's readings are in doubt

    @property
    def stops(self) -> bool:
        """Whether it is to be mended before an analysis, unlike the zero of an encoder, which an analysis finds."""
        return self.doubtful and (self.channel, self.kind) != ("crank_angle", "phase")


@dataclass(frozen=True)
class Orders:
    """Low orders of a channel in one run."""

    measured: np.ndarray  # [SI] Channel = Re sum C_k exp(i k angle)
    expected: np.ndarray  # [SI] Channel = Re sum C_k exp(i k angle)
    error: float  # [SI] Standard error of the measured orders' norm

    @property
    def factor(self) -> float:
        """Size of the measured orders over that of those expected."""
        return float(np.linalg.norm(self.measured) / np.linalg.norm(self.expected))

    def shifted(self, phase: float) -> "Orders":
        """The same with the expected motion ahead by `phase` [rad]."""
        turned = self.expected * np.exp(1j * phase * np.arange(1, self.expected.size + 1))
        return Orders(self.measured, turned, self.error)

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


def contradictions(
    campaign: Campaign, recordings: Mapping[str, Recording], limits: RecordingLimits = DEFAULT_LIMITS
) -> list[Contradiction]:
    """What channels contradict each other, or the mechanism's ideal motion."""
    runs = {run.id: run for run in campaign.runs if run.id in recordings}
    found: list[Contradiction] = []
    cranks: dict[str, _Crank] = {}
    compared: dict[str, dict[str, Orders]] = {}
    for name, run in runs.items():
        crank = _crank(campaign, run, recordings[name], limits)
        if crank is not None:
            found += crank.clock
            cranks[name] = crank
            compared[name] = _all_orders(campaign, recordings[name], crank.angle, crank.speed, limits)
    found += [doubt for name, run in runs.items() for doubt in _crank_speed(campaign, run, recordings[name], limits)]
    encoder = "crank_angle" in campaign.channels
    zeros = _encoder_zeros(campaign, compared, limits) if encoder else {}
    found += _doubts_of_zeros(campaign, compared, zeros)
    # what is ahead by the encoder's offset in the mechanism is read at a larger angle
    compared = {run: {c: o.shifted(-zeros.get(run, 0.0)) for c, o in own.items()} for run, own in compared.items()}
    swapped, taken = _swapped(campaign, compared, limits)
    found += swapped
    strays = _strays(recordings, cranks, limits)
    for channel in campaign.channels:
        own = {run: orders[channel] for run, orders in compared.items() if channel in orders}
        stray = [one for one in strays if one.channel == channel]
        if channel in taken:
            continue
        found += stray
        if own := {run: orders for run, orders in own.items() if run not in [one.run for one in stray]}:
            found += _doubts(campaign, channel, own, [cranks[run].speed for run in own], limits)
    return found


@dataclass(frozen=True)
class _Crank:
    """How the crank turns in one run: angle (n,) [rad] and speed [rad/s] with the sign of the file, and doubts of the
    times.
    """

    angle: np.ndarray
    speed: float
    clock: tuple[Contradiction, ...] = ()


def _crank(campaign: Campaign, run: CampaignRun, recording: Recording, limits: RecordingLimits) -> _Crank | None:
    """How the crank turns; None where it is not known, or not steady.

    Without an encoder it turns at the speed at which the channels agree best with the ideal motion.
    """
    sign = -1.0 if run.direction == "clockwise" else 1.0
    if not recording.has_angle:
        return _crank_without_encoder(campaign, run, recording, sign, limits)
    angle = sign * recording.crank_angle
    if not recording.has_time:
        return _Crank(angle, sign * run.speed)
    finite = np.isfinite(angle)
    time, turned = recording.time[finite], np.abs(angle[finite] - angle[finite][0])
    speed = turned[-1] / (time[-1] - time[0])
    quarter = np.interp(time + tau / 4 / speed, time, turned) - turned
    whole = time + tau / 4 / speed <= time[-1]
    if np.std(quarter[whole]) > limits.steady_speed * tau / 4:
        return None
    if campaign.drive != "constant_speed" or abs(np.log(speed / run.speed)) < np.log(limits.speed_doubted):
        return _Crank(angle, sign * speed)
    orders = _all_orders(campaign, recording, angle, sign * speed, limits)
    clock = _clock(run, speed, orders, "with crank_angle", measured=True)
    return _Crank(angle, sign * (run.speed if clock.kind == "time" else speed), (clock,))


def _crank_speed(
    campaign: Campaign, run: CampaignRun, recording: Recording, limits: RecordingLimits
) -> list[Contradiction]:
    """Whether a channel of the crank's speed is the rate of its angle, or else near the run's speed, on the mean."""
    if "crank_speed" not in recording.channels:
        return []
    sign = -1.0 if run.direction == "clockwise" else 1.0
    speed, source = sign * run.speed, "the speed of the run"
    if recording.has_angle and recording.has_time:
        finite = np.flatnonzero(np.isfinite(recording.crank_angle))[[0, -1]]
        turned, lapse = (np.diff(values[finite])[0] for values in (recording.crank_angle, recording.time))
        speed, source = sign * turned / lapse, "the rate of crank_angle"
    factor = float(np.nanmean(recording.channels["crank_speed"])) / speed
    if -1.0 / limits.gains[0] < factor < -limits.gains[0]:
        sentence = _sign_sentence(campaign, "crank_speed", source)
        return [Contradiction(run.id, "crank_speed", "sign", sentence, factor=factor)]
    if limits.gains[0] < factor < limits.gains[1] or (campaign.drive == "motor" and not recording.has_angle):
        return []
    sentence = _scale_sentence(campaign, "crank_speed", factor, source, limits)
    return [Contradiction(run.id, "crank_speed", "scale", sentence, factor=factor)]


def _clock(
    run: CampaignRun, speed: float, orders: Mapping[str, Orders], source: str, measured: bool = False
) -> Contradiction:
    """That the times of a run make another `speed` [rad/s] than it states, and which of both the channels bear out.

    Where times and crank angles are `measured` the stated speed is of no use, and the times are in doubt only where
    other channels say so.
    """
    ratio = np.log(speed / run.speed)
    # a rate that is as large as it is at the stated speed says that the times are wrong
    votes = [
        -np.log(own.factor) / (SPEED_POWERS[name] * ratio)
        for name, own in orders.items()
        if SPEED_POWERS[name] and name not in FORCES and abs(own.correlation) > 0.5
    ] or [
        -np.log(own.factor) / (SPEED_POWERS[name] * ratio)
        for name, own in orders.items()
        if SPEED_POWERS[name] and abs(own.correlation) > 0.5
    ]
    kind, which = "time", "either may be wrong"
    if votes:
        kind = "time" if np.median(votes) > 0.5 else "speed"
        which = {
            "time": "the other channels are as large as at the stated speed, so the times are wrong",
            "speed": "the other channels are as large as at that one, so the stated speed is wrong",
        }[kind]
    return Contradiction(
        run.id,
        "time",
        kind,
        f"the times of the file make {60 * speed / tau:.4g} rpm {source}, but the run's speed is "
        f"{60 * run.speed / tau:.4g} rpm; {which}",
        factor=speed / run.speed,
        doubtful=not measured or (kind == "time" and bool(votes)),
    )


def _crank_without_encoder(
    campaign: Campaign, run: CampaignRun, recording: Recording, sign: float, limits: RecordingLimits
) -> _Crank | None:
    if campaign.drive != "constant_speed":
        return None
    elapsed = recording.time - recording.time[0]
    nominal, first = _agreement(campaign, recording, elapsed, sign * run.speed, limits)
    as_stated = _Crank(sign * run.speed * elapsed + first, sign * run.speed)
    if nominal > limits.same_agreement:
        return as_stated
    found = _speed_that_agrees(campaign, recording, elapsed, sign * run.speed, limits)
    if found is None:
        return as_stated
    ratio, (best, first) = found
    if best < limits.least_agreement or nominal > limits.same_agreement * best:
        return as_stated
    angle, speed = sign * run.speed * ratio * elapsed + first, ratio * run.speed
    if abs(np.log(ratio)) < np.log(limits.speed_doubted):
        return _Crank(angle, sign * speed)
    orders = _all_orders(campaign, recording, angle, sign * speed, limits)
    clock = _clock(run, speed, orders, f"by what repeats in {', '.join(orders)}")
    return _Crank(angle, sign * (run.speed if clock.kind == "time" else speed), (clock,))


def _agreement(
    campaign: Campaign, recording: Recording, elapsed: np.ndarray, speed: float, limits: RecordingLimits
) -> tuple[float, float]:
    """Mean share of the variance that the ideal motion at a `speed` [rad/s] explains at the best first angle, and that
    angle [rad]; of the channels that follow from the geometry where there are any, for loads change the others.

    `elapsed` (n,) [s] may be NaN where samples are left out.
    """
    orders = _all_orders(campaign, recording, speed * elapsed, speed, limits)
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
    campaign: Campaign, recording: Recording, elapsed: np.ndarray, stated: float, limits: RecordingLimits
) -> tuple[float, tuple[float, float]] | None:
    """Ratio of the speed at which the channels agree best to the `stated` one [rad/s], and `_agreement` there.

    The first turns are searched through, longer parts only about what these give. None where there is nothing to
    compare. Of forces alone no ratio is taken at which their strongest order is a whole one at the stated speed, where
    a load has its orders.
    """
    total = abs(stated) * float(elapsed[-1]) / tau
    turns = min(total, limits.searched_turns)
    shape = _all_orders(campaign, recording, stated * elapsed, stated, limits)
    if not shape:
        return None
    forces_alone = all(name in FORCES for name in shape)
    strongest = [1 + int(np.argmax(np.abs(own.expected))) for own in shape.values()] if forces_alone else []
    low, high = limits.searched_speed_ratios
    while True:
        part = np.where(elapsed <= turns * tau / abs(stated), elapsed, np.nan)
        ratios = np.geomspace(low, high, int(np.log(high / low) * 6.0 * turns) + 2)
        for order in strongest:
            away = np.abs(order * ratios - np.round(order * ratios))
            ratios = ratios[away > limits.order_of_a_load]
        if not ratios.size:
            return None
        tried = [_agreement(campaign, recording, part, stated * ratio, limits) for ratio in ratios]
        best = max(range(len(tried)), key=lambda place: tried[place][0])
        if turns >= total:
            return float(ratios[best]), tried[best]
        low, high = ratios[best] * np.exp(np.array([-0.5, 0.5]) / turns)
        turns = min(4.0 * turns, total)


def _all_orders(
    campaign: Campaign, recording: Recording, angle: np.ndarray, speed: float, limits: RecordingLimits
) -> dict[str, Orders]:
    """`Orders` of the channels of a run whose crank is at `angle` (n,) [rad] at a mean `speed` [rad/s].

    Of forces only where no load but gravity is known, and the crank's own inertia takes no torque.
    """
    finite = angle[np.isfinite(angle)]
    per_turn = finite.size * tau / abs(finite[-1] - finite[0])
    count = int(np.clip(per_turn / 4, 1, limits.compared_orders))
    loaded = any(effect.name != "gravity" for effect in campaign.mechanism.effects)
    expected = ideal_orders(campaign.mechanism, speed, count)
    columns = _harmonics(angle, count)
    orders = {}
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
    left = values - columns @ solution
    independent = min(per_turn, values.size)
    return solution[1 : count + 1] - 1j * solution[count + 1 :], float(
        np.std(left) * np.sqrt(4.0 * count / independent)
    )


def _strays(
    recordings: Mapping[str, Recording], cranks: Mapping[str, _Crank], limits: RecordingLimits
) -> list[Contradiction]:
    """Channels that repeat with the crank in all runs but one, and in that one at another speed or as another run."""
    repeats = {
        run: {name: _repeats(crank.angle, values, limits) for name, values in recordings[run].channels.items()}
        for run, crank in cranks.items()
    }
    found = []
    for run, own in repeats.items():
        if max(own.values(), default=0.0) < limits.repeating_share:
            continue
        for name, value in own.items():
            others = [shares[name] for other, shares in repeats.items() if other != run]
            strange = value < limits.stray_share and others and min(others) > limits.repeating_share
            if strange and _is_of_another(recordings, run, cranks[run].angle, name, limits):
                sentence = f"{name} does not repeat with the crank as in the other runs; is it from another run's file?"
                found.append(Contradiction(run, name, "unrelated", sentence))
    return found


def _is_of_another(
    recordings: Mapping[str, Recording], run: str, angle: np.ndarray, name: str, limits: RecordingLimits
) -> bool:
    """Whether a channel of a run has another run's samples, or repeats at another speed than the run's crank.

    Noise and impacts, which do not repeat with the crank either, do neither.
    """
    values = recordings[run].channels[name]
    for other, recording in recordings.items():
        count = min(values.size, recording.channels[name].size)
        both = np.column_stack([values[:count], recording.channels[name][:count]])
        both = both[np.isfinite(both).all(axis=1)]
        if other != run and len(both) > limits.min_samples and np.corrcoef(both.T)[0, 1] > limits.same_samples:
            return True
    finite = np.isfinite(angle)
    turned = np.abs(np.interp(np.arange(angle.size), np.flatnonzero(finite), angle[finite]) - angle[finite][0])
    part = turned <= limits.searched_turns * tau
    turned, values = turned[part], values[part]
    turns = turned[-1] / tau
    low, high = limits.least_stray_turns / turns, turned.size / turns / (4.0 * limits.compared_orders)
    variance, count = float(np.nanvar(values)), limits.compared_orders
    for ratio in np.geomspace(low, high, int(np.log(high / low) * 6.0 * turns * high) + 2) if high > low else ():
        error = _low_orders(_harmonics(ratio * turned, count), values, 1.0)[1]
        if 1.0 - error**2 / (4.0 * count) / variance > limits.repeating_share:
            return True
    return False


def _repeats(angle: np.ndarray, values: np.ndarray, limits: RecordingLimits) -> float:
    """Share of the variance of `values` (n,) that comes back with the crank's `angle` (n,): low orders, or a turn on.

    The larger one: impacts have high orders, and few samples a turn cannot be compared with those of the next.
    """
    finite = np.flatnonzero(np.isfinite(angle))
    bridged = np.abs(np.interp(np.arange(angle.size), finite, angle[finite]))
    variance = float(np.nanvar(values))
    per_turn = angle.size * tau / (bridged[-1] - bridged[0])
    columns = _harmonics(angle, int(np.clip(per_turn / 4, 1, limits.compared_orders)))
    left = _low_orders(columns, values, 1.0)[1] ** 2 / (2.0 * (columns.shape[1] - 1))
    scatter = cycle_scatter(bridged, values)
    return 1.0 - min(left, scatter**2 if np.isfinite(scatter) else left) / variance


def _harmonics(angle: np.ndarray, count: int) -> np.ndarray:
    """Regressors (n, 1 + 2 count): a constant, cosines and sines of the multiples of the `angle` (n,) [rad]."""
    turning = np.exp(1j * angle)
    powers = [turning**order for order in range(1, count + 1)]
    return np.column_stack([np.ones(angle.size), *(p.real for p in powers), *(p.imag for p in powers)])


def _encoder_zeros(
    campaign: Campaign, compared: Mapping[str, Mapping[str, Orders]], limits: RecordingLimits
) -> dict[str, float]:
    """By how much [rad] the encoder of each run reads too much, where that is far: one amount in all, or each its own.

    One channel that is off in one run alone is no evidence of the encoder, unless its zero is listed as not known.
    """
    if common := _common_phase(compared, limits):
        return dict.fromkeys(compared, common)
    least = 1 if "encoder_zero" in campaign.nuisance else 2
    several = {run: own for run, own in compared.items() if sum(name not in FORCES for name in own) >= least}
    zeros = {run: _common_phase({run: own}, limits) for run, own in several.items()}
    return {run: zero for run, zero in zeros.items() if zero}


def _doubts_of_zeros(
    campaign: Campaign, compared: Mapping[str, Mapping[str, Orders]], zeros: Mapping[str, float]
) -> list[Contradiction]:
    """Doubts of the encoder's zero [rad], by run, beyond the bounds that are listed for it."""
    low, high = campaign.nuisance.get("encoder_zero", (0.0, 0.0))
    step = pi / 180  # of the zeros that are tried
    found = []
    for run, zero in zeros.items():
        if low - step < zero < high + step:
            continue
        alike = [other for other, own in zeros.items() if own == zero]
        channels = sorted({channel for other in alike for channel in compared[other]})
        sentence = (
            f"the zero of crank_angle is off: {', '.join(channels)} follow from the mechanism if it reads "
            f"{degrees(zero):.0f} deg too much; correct it, or see whether encoder_offset is named"
        )
        found.append(Contradiction(run, "crank_angle", "phase", sentence, phase=zero))
    return found


def _common_phase(compared: Mapping[str, Mapping[str, Orders]], limits: RecordingLimits) -> float:
    """Offset [rad] of the encoder's reading at which all channels of all runs follow, where they do not without; or 0.

    Forces are asked only where there is no other channel.
    """
    series = [(name, own) for orders in compared.values() for name, own in orders.items() if own.is_clear(0.3)]
    geometric = [own for name, own in series if name not in FORCES]
    asked = geometric or [own for _, own in series]
    if not asked or not (geometric or _no_load_does(series, limits)):
        return 0.0
    least = limits.comparable_correlation if geometric else limits.force_correlation
    if any(own.correlation > least for own in asked):
        return 0.0
    phases = np.arange(-180, 180) * (pi / 180)
    agreement = np.array([[own.shifted(-phase).correlation for own in asked] for phase in phases])
    best = int(np.argmax(agreement.sum(axis=1)))
    if agreement[best].min() < least or abs(phases[best]) < limits.least_phase_rad:
        return 0.0
    # one channel of the opposite sign or of another kind is no evidence of the encoder
    flipped = [min(own.misfit(1.0 / own.factor), own.misfit(-1.0 / own.factor)) for own in asked]
    turned = [own.shifted(-phases[best]).misfit(1.0 / own.factor) for own in asked]
    return float(phases[best]) if np.mean(turned) < 0.7 * np.mean(flipped) else 0.0


def _no_load_does(series: Sequence[tuple[str, Orders]], limits: RecordingLimits) -> bool:
    """Whether forces, by channel, are about as large as expected in runs at speeds at which loads are not.

    What is expected grows with the square of the speed.
    """
    for name in {name for name, _ in series}:
        factors = [own.factor for other, own in series if other == name]
        expected = [float(np.linalg.norm(own.expected)) for other, own in series if other == name]
        apart = np.sqrt(max(expected) / min(expected))
        usual = limits.gains_of_forces[0] < min(factors) and max(factors) < limits.gains_of_forces[1]
        if not usual or max(factors) > limits.alike_factors * min(factors) or apart < limits.apart_speeds:
            return False
    return True


def _swapped(
    campaign: Campaign, compared: Mapping[str, Mapping[str, Orders]], limits: RecordingLimits
) -> tuple[list[Contradiction], set[str]]:
    """Pairs of channels each of which is what the other is said to be, and the channels in them."""
    names = [name for name in campaign.channels if any(name in own for own in compared.values())]
    candidates = []
    for place, first in enumerate(names):
        for second in names[place + 1 :]:
            runs = [run for run, own in compared.items() if first in own and second in own]
            scale = campaign.factor(second) / campaign.factor(first)  # the columns were read in each other's unit
            as_is, exchanged, geometric = [], [], []
            for channel, other, factor in ((first, second, 1.0 / scale), (second, first, scale)):
                here = [compared[run][channel] for run in runs]
                there = [compared[run][other] for run in runs]
                as_is.append(np.median([own.misfit() for own in here]))
                exchanged.append(
                    np.median(
                        [
                            Orders(one.measured, own.expected, one.error).misfit(factor)
                            for own, one in zip(here, there, strict=True)
                        ]
                    )
                )
                geometric.append(channel not in FORCES)
            loads = not all(geometric)
            most = [limits.exchanged_misfit if own else limits.exchanged_force_misfit for own in geometric]
            enough = all(a > limits.swapped_misfit and e < m for a, e, m in zip(as_is, exchanged, most, strict=True))
            gain = sum(exchanged) / sum(as_is)
            if enough and gain < (limits.swapped_gain_of_forces if loads else limits.swapped_gain):
                candidates.append((gain, first, second, runs))
    found, taken = [], set()
    for _, first, second, runs in sorted(candidates):
        if taken & {first, second}:
            continue
        taken |= {first, second}
        columns = (campaign.channels[first].column, campaign.channels[second].column)
        sentence = (
            f"{first} and {second} are swapped: column {columns[0]} is what the mechanism makes of {second}, "
            f"and column {columns[1]} of {first}; exchange the two columns in the campaign file"
        )
        for channel, other in ((first, second), (second, first)):
            found += [Contradiction(run, channel, "swapped", sentence, other) for run in runs]
    return found, taken


def _doubts(
    campaign: Campaign, channel: str, runs: Mapping[str, Orders], speeds: Sequence[float], limits: RecordingLimits
) -> list[Contradiction]:
    """What is wrong with one channel, run by run at `speeds` [rad/s]; of forces only what is wrong in all runs alike.

    And only where the speeds are so far apart that a load that does not grow with them, or does so in proportion, is
    not alike.
    """
    force = channel in FORCES
    clear = {run: own for run, own in runs.items() if own.is_clear(limits.clear_error)}
    if not clear:
        return []
    correlations = {run: own.correlation for run, own in clear.items()}
    factors = {run: own.factor for run, own in clear.items()}
    spread = max(factors.values()) / max(min(factors.values()), 1e-300)
    alike = spread < limits.alike_factors
    clear_speeds = [abs(speed) for run, speed in zip(runs, speeds, strict=True) if run in clear]
    apart = max(clear_speeds) / min(clear_speeds)
    if force:
        least, gains = limits.force_correlation, limits.gains_of_forces
    else:
        least, gains = limits.comparable_correlation, limits.gains
    reference = "what the mechanism makes of the crank's motion"

    def told(run: str, kind: str, sentence: str, **found: float) -> Contradiction:
        return Contradiction(run, channel, kind, sentence, **found)

    common = float(np.median(list(factors.values())))
    of_sensor = alike and gains[0] < common < gains[1] and apart > limits.apart_speeds
    if all(value < -least for value in correlations.values()) and (of_sensor or not force):
        sentence = _sign_sentence(campaign, channel, reference)
        return [told(run, "sign", sentence, factor=-factors[run]) for run in clear]
    if all(value > least for value in correlations.values()) and alike:
        if gains[0] < common < gains[1] or (force and apart <= _apart_enough(common, limits)):
            return []
        sentence = _scale_sentence(campaign, channel, common, reference, limits)
        return [told(run, "scale", sentence, factor=common) for run in clear]
    if force:
        return []
    doubts = []
    for run, value in correlations.items():
        own = clear[run]
        if value < -least:
            sentence = _sign_sentence(campaign, channel, reference)
            doubts.append(told(run, "sign", sentence, factor=-own.factor))
        elif value > least:
            if not gains[0] < own.factor < gains[1]:
                sentence = _scale_sentence(campaign, channel, own.factor, reference, limits)
                doubts.append(told(run, "scale", sentence, factor=own.factor))
        elif value < limits.unrelated_correlation or own.factor * value < limits.share_of_usual:
            phase = _own_phase(own)
            if phase is not None:
                sentence = f"{channel} is {degrees(phase):.0f} deg off {reference}; check how it was synchronised"
                doubts.append(told(run, "phase", sentence, factor=own.factor, phase=phase))
                continue
            sentence = (
                f"{channel} is not {reference} (correlation {value:.2f}); check the columns, the sensor, and whether "
                "it is of this run"
            )
            doubts.append(told(run, "unrelated", sentence, factor=own.factor))
    return doubts


def _apart_enough(factor: float, limits: RecordingLimits) -> float:
    """Ratio of speeds [1] at which a load that grows in proportion to them does not make forces `factor` times what is
    expected in all runs alike.

    Beside inertia, which grows with the square, it is the smaller the faster the run: the ratio of what it would have
    to be at factors that are still alike.
    """
    spread = np.sqrt(limits.alike_factors)
    loads = abs(factor * spread - 1.0), abs(factor / spread - 1.0)
    return max(loads) / min(loads)


def _own_phase(own: Orders) -> float | None:
    """Shift [rad] by which one channel is what is expected; None where it is not at any."""
    phases = np.arange(-180, 180) * (pi / 180)
    agreement = [own.shifted(-phase).correlation for phase in phases]
    best = int(np.argmax(agreement))
    return float(phases[best]) if agreement[best] > 0.97 and 0.8 < own.factor < 1.25 else None


def _sign_sentence(campaign: Campaign, channel: str, reference: str) -> str:
    turned = campaign.channels[channel].sign == -1
    mend = "remove the channel's sign: -1" if turned else "give the channel sign: -1"
    return f"{channel} has the opposite sign of {reference}; check the sensor's direction, or {mend}"


def _scale_sentence(campaign: Campaign, channel: str, factor: float, reference: str, limits: RecordingLimits) -> str:
    stated, own = campaign.channels[channel], campaign.factor(channel)
    sentence = f"{channel} is {factor:.4g} times {reference}; check "
    if stated.scale is not None:
        return f"{sentence}channels.{channel}.scale = '{stated.scale}'"
    unit, sentence = stated.unit, f"{sentence}the units of both"
    for other in UNITS[CHANNELS[channel]]:
        if abs(factor * unit_factor(other, CHANNELS[channel]) / own - 1.0) < limits.unit_tolerance:
            return f"{sentence}: did you mean '{other}' by channels.{channel}.unit = '{unit}'?"
    return sentence


def sentences(found: Sequence[Contradiction]) -> list[str]:
    """The remarks of `found`, each once with the runs that it is of."""
    runs: dict[str, list[str]] = {}
    for one in found:
        runs.setdefault(one.remark, []).append(one.run)
    return [
        f"run{'s' if len(own) > 1 else ''} {', '.join(dict.fromkeys(own))}: {sentence}"
        for sentence, own in runs.items()
    ]
