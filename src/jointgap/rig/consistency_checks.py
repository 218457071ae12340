"""Consistency checks of channels with the ideal motion: sign, scale, phase, swapped columns, times.

The low orders of each channel over the crank angle are compared with those of the ideal mechanism:
kinematics of positions, speeds and accelerations, inverse dynamics of torque and forces. Loads,
friction and clearance hardly change the low orders of accelerations. They change forces; so forces
are checked only for deviations that are alike in runs at very different speeds."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import degrees, log, pi, sqrt, tau

import numpy as np
from scipy.signal import butter

from jointgap.config.campaign import FILTER_ORDER, UNITS, Campaign, CampaignRun, Channel
from jointgap.config.channels import CHANNEL_KINDS, CHANNELS, FORCES
from jointgap.core.units import counts_near, split_share, unit_factor
from jointgap.core.words import joined, number
from jointgap.dynamics.kinematics import ideal_orders
from jointgap.rig.recording import Contradiction, Recording
from jointgap.rig.sampling import aperiodic_share, speed_from_periodicity

MAX_ORDER = 4  # Highest crank order compared with the ideal motion
MIN_CORRELATION, MIN_CORRELATION_OF_FORCES = 0.9, 0.8  # Required for a factor between two channels
GAINS, GAINS_OF_FORCES = (0.8, 1.25), (0.5, 2.0)  # Plausible factors by a sensor's gain or a load
# Ratio up to which factors of several runs are equal, and from which speeds are very different
ALIKE = 1.35
MIN_HELD = 8  # Changes of a reading that is held
SEARCHED_TURNS = 20.0  # Turns used to search a speed
PERIOD_TURNS = (
    4.0  # From which the period of the channels is compared with the turn of the crank angle
)
LEAST_APERIODIC = 0.02  # [1, of each channel's variance] From which another period is tried
LEAST_PERIOD_ERROR = 0.005  # [1] Of a turn; lags of sensors while the speed drifts cause less
_PHASES = np.arange(-180, 180) * (pi / 180)
_REFERENCE = "the value computed from the crank motion"


@dataclass(frozen=True)
class Orders:
    """Low crank orders of a channel in one run: channel [SI] = Re sum C_k exp(i k angle)."""

    measured: np.ndarray
    expected: np.ndarray
    error: float  # [SI] Standard error of the measured orders' norm
    variance: float  # [SI] Of the channel
    speed: float  # [rad/s]

    @property
    def factor(self) -> float:
        """Norm of the measured over that of the expected orders."""
        return float(np.linalg.norm(self.measured) / np.linalg.norm(self.expected))

    @property
    def correlation(self) -> float:
        """Cosine between measured and expected orders; NaN if one is zero."""
        size = np.linalg.norm(self.measured) * np.linalg.norm(self.expected)
        return float(np.real(np.vdot(self.expected, self.measured)) / size) if size else np.nan

    def shifted(self, phase: float) -> "Orders":
        """The same with the expected orders advanced by `phase` [rad]."""
        return replace(
            self, expected=self.expected * np.exp(1j * phase * np.arange(1, self.expected.size + 1))
        )

    def misfit(self, scale: float = 1.0) -> float:
        """Relative distance of `scale` times the measured orders from the expected ones."""
        return float(
            np.linalg.norm(scale * self.measured - self.expected) / np.linalg.norm(self.expected)
        )

    def is_clear(self, share: float) -> bool:
        """Whether noise is below a `share` of the measured or expected orders."""
        return self.error < share * max(
            np.linalg.norm(self.measured), np.linalg.norm(self.expected)
        )


AllOrders = Mapping[str, Mapping[str, Orders]]  # By run and channel, of runs with a steady crank


def consistency_checks(
    campaign: Campaign, recordings: Mapping[str, Recording]
) -> list[Contradiction]:
    """Channels that are inconsistent with each other or with the ideal motion."""
    runs = [run for run in campaign.runs if run.id in recordings]
    orders, times, periods = {}, [], {}
    for run in runs:
        if (crank := _crank(campaign, run, recordings[run.id])) is not None:
            angle, speed, wrong_times = crank
            own = _orders(campaign, recordings[run.id], angle, speed)
            orders[run.id], unsure = _at_one_clock(run.id, own, recordings[run.id].second_clock)
            times += [*wrong_times, *unsure]
            periods[run.id] = _period(campaign, recordings[run.id], angle, speed)
    if turns := _wrong_turns(campaign, periods):
        return turns  # the other checks presume the angle
    zeros = _encoder_zeros(campaign, orders) if "crank_angle" in campaign.channels else {}
    shifted = {
        run: {c: o.shifted(-zeros.get(run, 0.0)) for c, o in own.items()}
        for run, own in orders.items()
    }
    swapped = _swapped(campaign, shifted)
    exchanged = {one.channel for one in swapped}
    others = swapped + [one for one in _copied(recordings, orders) if one.channel not in exchanged]
    reported = {(one.run, one.channel) for one in others}
    for channel in campaign.channels:
        own = {
            run: each[channel]
            for run, each in shifted.items()
            if channel in each and (run, channel) not in reported
        }
        others += _of_channel(campaign, channel, own)
    speeds = (found for run in runs for found in _crank_speed(campaign, run, recordings[run.id]))
    return [*times, *speeds, *_wrong_zeros(campaign, orders, zeros), *others]


def _at_one_clock(
    run: str, orders: Mapping[str, Orders], second: Sequence[str]
) -> tuple[dict[str, Orders], list[Contradiction]]:
    """The orders of a run with those expected of the channels of a `second` clock at its most
    likely offset, and a remark if another offset is nearly as likely.
    """
    asked = [own for name, own in orders.items() if name in second and own.is_clear(0.3)]
    if not asked:
        return {**orders}, []
    agreement = np.array(
        [np.mean([own.shifted(-phase).correlation for own in asked]) for phase in _PHASES]
    )
    phase = _PHASES[np.argmax(agreement)]
    apart = np.abs(np.remainder(_PHASES - phase + pi, tau) - pi) > pi / 4
    other, found = _PHASES[apart][np.argmax(agreement[apart])], []
    if agreement[apart].max() > 0.95 * agreement.max():
        first, second_best = (1e3 * each / asked[0].speed for each in (phase, other))
        text = (
            f"the offset of the second file's clock may be {first:.3g} ms or {second_best:.3g} ms,"
            f" as {joined(second)} nearly repeats within a revolution; record one channel with both"
            " loggers, or check which one is found"
        )
        found = [Contradiction(run, second[0], "clock", text, doubtful=False)]
    return {
        name: own.shifted(-phase) if name in second else own for name, own in orders.items()
    }, found


# Crank motion of one run with the sign of the file: angles [rad], speed [rad/s], inconsistent times
Crank = tuple[np.ndarray, float, list[Contradiction]]


def _crank(campaign: Campaign, run: CampaignRun, recording: Recording) -> Crank | None:
    """The crank motion; None if unknown or unsteady."""
    sign = -1.0 if run.direction == "clockwise" else 1.0
    if not recording.has_angle:
        return _crank_without_encoder(campaign, run, recording, sign * run.speed)
    angle = sign * recording.crank_angle
    if not recording.has_time:
        return angle, sign * run.speed, []
    finite = np.isfinite(angle)
    # a second logger has samples between those of the encoder
    angle = np.interp(
        recording.time, recording.time[finite], angle[finite], left=np.nan, right=np.nan
    )
    finite = np.isfinite(angle)
    time, turned = recording.time[finite], np.abs(angle[finite] - angle[finite][0])
    speed = turned[-1] / (time[-1] - time[0])
    quarter = np.interp(time + tau / 4 / speed, time, turned) - turned
    if np.std(quarter[time + tau / 4 / speed <= time[-1]]) > 0.15 * tau / 4:
        return None
    return _timed(campaign, run, recording, angle, sign * speed)


def _timed(
    campaign: Campaign, run: CampaignRun, recording: Recording, angle: np.ndarray, speed: float
) -> Crank:
    """The crank at the speed that the other channels confirm; a contradiction if the stated speed
    and that from times differ by more than 10 %.

    If times and crank angles are measured the stated speed is not used; then only other channels
    can refute the times.
    """
    ratio = log(abs(speed) / run.speed)
    if campaign.drive != "constant_speed" or abs(ratio) < log(1.1):
        return angle, speed, []
    orders = _orders(campaign, recording, angle, speed)
    powers = {name: CHANNEL_KINDS[name].speed_power for name in orders}
    rates = {c: o for c, o in orders.items() if powers[c] and abs(o.correlation) > 0.5}
    rates = {c: o for c, o in rates.items() if c not in FORCES} or rates
    # rates that agree with the stated speed refute the times
    votes = [-log(own.factor) / (powers[channel] * ratio) for channel, own in rates.items()]
    kind, which = "time", "correct one of them"
    if votes:
        kind = "time" if np.median(votes) > 0.5 else "speed"
        which = (
            "the other channels agree with the "
            + {
                "time": "stated speed, so correct the times",
                "speed": "times, so correct the stated speed",
            }[kind]
        )
    source = "crank_angle" if recording.has_angle else f"the period of {', '.join(orders)}"
    sentence = (
        f"the speed from the times and {source} is {number(60 * abs(speed) / tau)} rpm, but the"
        f" run's speed is {number(60 * run.speed / tau)} rpm; {which}"
    )
    doubtful = not recording.has_angle or (kind == "time" and bool(votes))
    found = Contradiction(
        run.id, "time", kind, sentence, factor=abs(speed) / run.speed, doubtful=doubtful
    )
    return angle, float(np.copysign(run.speed, speed)) if kind == "time" else speed, [found]


def _crank_without_encoder(
    campaign: Campaign, run: CampaignRun, recording: Recording, stated: float
) -> Crank | None:
    """The crank at the stated speed, or at the speed of the channels' period if that agrees much
    better with the ideal motion.
    """
    if campaign.drive != "constant_speed":
        return None
    elapsed = recording.time - recording.time[0]
    part = elapsed <= SEARCHED_TURNS * tau / run.speed
    elapsed[~part] = np.nan
    orders = _orders(campaign, recording, stated * elapsed, stated)
    nominal, first = _agreement(orders)
    if orders and nominal <= 0.6:
        values = [recording.channels[name][part] for name in orders]
        speed = speed_from_periodicity(elapsed[part], values, 0.53 * run.speed, 1.9 * run.speed)
        speed = float(np.copysign(speed, stated))
        found, angle = _agreement(_orders(campaign, recording, speed * elapsed, speed))
        if found >= max(0.5, nominal / 0.6):
            return _timed(campaign, run, recording, speed * elapsed + angle, speed)
    return stated * elapsed + first, stated, []


def _agreement(orders: Mapping[str, Orders]) -> tuple[float, float]:
    """Mean share of the variance explained by the ideal motion at the best first angle, and that
    angle [rad]; without forces if there are other channels.
    """
    asked = [own for name, own in orders.items() if name not in FORCES] or list(orders.values())
    phases = np.arange(180) * (tau / 180)
    scores = np.zeros(phases.size)
    for own in asked:
        turning = np.exp(-1j * np.outer(phases, np.arange(1, own.expected.size + 1)))
        projected = np.real(turning @ (own.expected.conj() * own.measured)) / np.linalg.norm(
            own.expected
        )
        scores += np.maximum(projected, 0.0) ** 2 / (2.0 * own.variance) / len(asked)
    best = int(np.argmax(scores))
    return float(scores[best]), float(phases[best])


def _orders(
    campaign: Campaign, recording: Recording, angle: np.ndarray, speed: float
) -> dict[str, Orders]:
    """`Orders` of the channels by regression, for the crank angles `angle` (n,) [rad] and the mean
    `speed` [rad/s].

    Forces only at constant speed and without loads besides gravity. As the residual may repeat
    every turn, the error counts the samples of one turn.
    """
    finite = angle[np.isfinite(angle)]
    per_turn = finite.size * tau / abs(finite[-1] - finite[0])
    count = int(np.clip(per_turn / 4, 1, MAX_ORDER))
    loaded = campaign.drive != "constant_speed" or any(
        one.name != "gravity" for one in campaign.mechanism.effects
    )
    loaded = loaded or bool(campaign.own_loads)
    expected, orders = ideal_orders(campaign.mechanism, speed, count), {}
    turning = np.exp(1j * angle)[:, None] ** np.arange(1, count + 1)
    columns = np.column_stack([np.ones(angle.size), turning.real, turning.imag])
    for name, values in recording.channels.items():
        used = np.isfinite(angle) & np.isfinite(values)
        if name not in expected or (name in FORCES and loaded) or used.sum() < 4 * count + 4:
            continue
        x, y = columns[used], values[used]
        weights = np.linalg.lstsq(x.T @ x, x.T @ y, rcond=None)[0]
        error = float(np.std(y - x @ weights) * sqrt(4.0 * count / min(per_turn, y.size)))
        filtered = expected[name] * _response(
            campaign.channels[name], speed * np.arange(1, count + 1)
        )
        if np.linalg.norm(filtered) > 0.0:
            measured = weights[1 : count + 1] - 1j * weights[count + 1 :]
            orders[name] = Orders(measured, filtered, error, float(np.var(y)), speed)
    return orders


def _period(campaign: Campaign, recording: Recording, angle: np.ndarray, speed: float) -> float:
    """Turns of the measured crank angle [1] after which the other channels repeat: 1 unless they
    repeat much better after another angle and agree better with the ideal motion there.
    """
    finite = angle[np.isfinite(angle)]
    turned = np.abs(finite - finite[0])
    per_turn = finite.size * tau / turned[-1]
    part = np.flatnonzero(np.isfinite(angle))[turned < SEARCHED_TURNS * tau][
        :: max(int(per_turn / 40), 1)
    ]
    if (
        not (recording.has_angle and recording.channels)
        or turned[-1] < PERIOD_TURNS * tau
        or part.size < 50
    ):
        return 1.0
    elapsed = np.abs(angle[part] - finite[0])
    values = [
        values[part]
        for values in recording.channels.values()
        if np.isfinite(values[part]).sum() >= 50
    ]
    here = aperiodic_share(1.0, elapsed, values) if values else 0.0
    if here <= LEAST_APERIODIC * len(values):
        return 1.0
    tried = (speed_from_periodicity(elapsed, values, 0.6, 2.05), 0.25, 4.0)
    least, ratio = min((aperiodic_share(each, elapsed, values), each) for each in tried)
    now, then = (
        _agreement(_orders(campaign, recording, angle * r, speed * r)) for r in (1.0, ratio)
    )
    return 1.0 / ratio if least < 0.3 * here and then[0] > max(now[0], 0.5) else 1.0


def _wrong_turns(campaign: Campaign, periods: Mapping[str, float]) -> list[Contradiction]:
    """A crank angle whose turn is no period of the other channels, alike in all runs."""
    found = [period for period in periods.values() if abs(period - 1.0) > LEAST_PERIOD_ERROR]
    if (
        len(found) < len(periods)
        or not found
        or max(found) - min(found) > LEAST_PERIOD_ERROR * min(found)
    ):
        return []
    period, stated = float(np.median(found)), campaign.channels["crank_angle"]
    sentence = f"the other channels repeat every {period:.4g} turn of crank_angle, not every turn; "
    if counts := counts_near(period * (parts := split_share(stated.unit)[1])):
        sentence += f"did you mean counts_per_turn: {counts} instead of {parts:g}?"
    else:
        sentence += (
            f"check channels.crank_angle.unit = '{stated.unit}', and whether the encoder turns with"
            " the crank"
        )
    return [
        Contradiction(run, "crank_angle", "scale", sentence, factor=1.0 / period) for run in periods
    ]


def _response(channel: Channel, frequencies: np.ndarray) -> np.ndarray:
    """Frequency response (k,) of a channel's filters at `frequencies` (k,) [rad/s]."""
    s, response = 1j * frequencies, np.ones(frequencies.size)
    if channel.bandwidth is not None:
        top, bottom = butter(FILTER_ORDER, tau * channel.bandwidth, analog=True)
        response = np.polyval(top, s) / np.polyval(bottom, s)
        response = response if channel.filter == "causal" else np.abs(response) ** 2
    if channel.high_pass is not None:
        response = response * s / (s + tau * channel.high_pass)
    if channel.average is not None:
        response = response * -np.expm1(-channel.average * s) / (channel.average * s)
    return response


def _crank_speed(
    campaign: Campaign, run: CampaignRun, recording: Recording
) -> Iterator[Contradiction]:
    """Check the mean of crank_speed against the rate of crank_angle or the run's speed."""
    if "crank_speed" not in recording.channels:
        return
    speed, source = run.speed, "the speed of the run"
    if recording.has_angle and recording.has_time:
        ends = np.flatnonzero(np.isfinite(recording.crank_angle))[[0, -1]]
        speed = np.ptp(recording.crank_angle[ends]) / np.ptp(recording.time[ends])
        source = "the rate of crank_angle"
    factor = float(np.nanmean(recording.channels["crank_speed"])) / speed
    factor *= -1.0 if run.direction == "clockwise" else 1.0
    unknown = campaign.drive == "motor" and not recording.has_angle
    if not GAINS[0] < factor < GAINS[1] and (not unknown or factor < 0.0):
        yield _off_by(factor, campaign, run.id, "crank_speed", source)
    elif (
        recording.has_angle
        and recording.has_time
        and campaign.channels["crank_speed"].average is None
    ):
        yield from _held_speed(run.id, recording)


def _held_speed(run: str, recording: Recording) -> Iterator[Contradiction]:
    """Check for speeds that are held for several samples and vary with the rate of the crank
    angle."""
    read, known = np.isfinite(recording.channels["crank_speed"]), np.isfinite(recording.crank_angle)
    time, speed = recording.time[read], recording.channels["crank_speed"][read]
    new = np.flatnonzero(np.diff(speed)) + 1
    held = np.diff(time[new])
    if (
        new.size < MIN_HELD
        or np.diff(new).min() < 2
        or np.ptp(np.diff(new)) > 1 + 0.1 * np.diff(new).max()
    ):
        return
    gate, late, best = float(np.mean(held)), 0.0, 0.0
    for delay in np.linspace(0.0, 2.0, 81) * gate:
        ends = time[new, None] - delay + gate * np.array([-0.5, 0.5])
        rate = np.diff(
            np.interp(ends, recording.time[known], recording.crank_angle[known]), axis=1
        )[:, 0]
        within = (ends[:, 0] > recording.time[known][0]) & (ends[:, 1] < recording.time[known][-1])
        if np.count_nonzero(within) > MIN_HELD // 2 and np.ptp(rate[within]) > 0.0:
            correlation = abs(float(np.corrcoef(rate[within], speed[new][within])[0, 1]))
            late, best = (float(delay), correlation) if correlation > best else (late, best)
    if best > MIN_CORRELATION:
        sentence = (
            f"crank_speed is not the rate of crank_angle: it is held for {1e3 * gate:.3g} ms and"
            f" {1e3 * late:.3g} ms late when it changes, as the mean of a counter; give it the key"
            f" 'average: {1e3 * gate:.3g} ms', or remove the channel"
        )
        yield Contradiction(run, "crank_speed", "held", sentence)


def _off_by(
    factor: float, campaign: Campaign, run: str, channel: str, reference: str
) -> Contradiction:
    """A channel that is `factor` times its `reference`, with the sign or unit that fits."""
    stated, unit = campaign.channels[channel], CHANNELS[channel]
    if factor < 0.0:
        fix = "remove the channel's sign: -1" if stated.sign == -1 else "give the channel sign: -1"
        sentence = (
            f"{channel} has the opposite sign of {reference}; check the sensor direction, or {fix}"
        )
        return Contradiction(run, channel, "sign", sentence, factor=factor)
    fix, own = "the units of both", campaign.factor(channel)
    if stated.scale is not None:
        fix = f"channels.{channel}.scale = '{stated.scale}'"
    elif fitting := [
        other for other in UNITS[unit] if abs(factor * unit_factor(other, unit) / own - 1.0) < 0.05
    ]:
        fix += (
            f": did you mean '{fitting[0]}' instead of channels.{channel}.unit = '{stated.unit}'?"
        )
    return Contradiction(
        run,
        channel,
        "scale",
        f"{channel} is {factor:.4g} times {reference}; check {fix}",
        factor=factor,
    )


def _encoder_zeros(campaign: Campaign, orders: AllOrders) -> dict[str, float]:
    """Large encoder offsets [rad] by run, common to all runs or not.

    A single channel of a single run is no evidence, unless encoder_zero is listed as a nuisance.
    """
    if common := _common_phase(orders):
        return dict.fromkeys(orders, common)
    least = 1 if "encoder_zero" in campaign.nuisance else 2
    several = {
        run: own for run, own in orders.items() if sum(name not in FORCES for name in own) >= least
    }
    return {run: zero for run, own in several.items() if (zero := _common_phase({run: own}))}


def _common_phase(orders: AllOrders) -> float:
    """Encoder offset [rad] that makes all channels of all runs consistent, if they are not already;
    else 0.

    Forces are used only if there is no other channel.
    """
    series = [
        (name, own) for each in orders.values() for name, own in each.items() if own.is_clear(0.3)
    ]
    asked, least = [own for name, own in series if name not in FORCES], MIN_CORRELATION
    if not asked:
        asked, least = [own for _, own in series], MIN_CORRELATION_OF_FORCES
        if not all(
            _no_load_does([own for other, own in series if other == name]) for name in dict(series)
        ):
            return 0.0
    if not asked or any(own.correlation > least for own in asked):
        return 0.0
    agreement = np.array([[own.shifted(-phase).correlation for own in asked] for phase in _PHASES])
    best = int(np.argmax(agreement.sum(axis=1)))
    phase = float(_PHASES[best])
    if agreement[best].min() < least or abs(phase) < 0.5:  # the analysis identifies a smaller one
        return 0.0
    # a channel with a wrong sign is no evidence of an encoder offset
    flipped = np.mean(
        [min(own.misfit(1.0 / own.factor), own.misfit(-1.0 / own.factor)) for own in asked]
    )
    return (
        phase
        if np.mean([own.shifted(-phase).misfit(1.0 / own.factor) for own in asked]) < 0.7 * flipped
        else 0.0
    )


def _no_load_does(runs: list[Orders]) -> bool:
    """Whether a force is about as large as expected in runs at very different speeds."""
    factors, speeds = [own.factor for own in runs], [abs(own.speed) for own in runs]
    usual = GAINS_OF_FORCES[0] < min(factors) and max(factors) < GAINS_OF_FORCES[1]
    return usual and max(factors) <= ALIKE * min(factors) and max(speeds) >= ALIKE * min(speeds)


def _wrong_zeros(
    campaign: Campaign, orders: AllOrders, zeros: Mapping[str, float]
) -> Iterator[Contradiction]:
    """Encoder zeros [rad] by run outside their listed bounds."""
    low, high = campaign.nuisance.get("encoder_zero", (0.0, 0.0))
    step = _PHASES[1] - _PHASES[0]
    for run, zero in zeros.items():
        if not low - step < zero < high + step:
            channels = sorted(
                {channel for other in zeros if zeros[other] == zero for channel in orders[other]}
            )
            sentence = (
                f"crank_angle has a wrong zero: {', '.join(channels)} are consistent if it reads"
                f" {degrees(zero):.0f} deg too much; correct it, or check whether encoder_offset is"
                " identified"
            )
            yield Contradiction(run, "crank_angle", "phase", sentence, phase=zero)


def _swapped(campaign: Campaign, orders: AllOrders) -> list[Contradiction]:
    """Pairs of channels with exchanged columns: both deviate by more than 15 %, and by less when
    exchanged."""
    pairs = []
    for first, second in combinations(campaign.channels, 2):
        runs = [run for run, own in orders.items() if first in own and second in own]
        if not runs:
            continue

        def off(channel: str, other: str, factor: float, runs: list[str] = runs) -> float:
            found = [
                replace(orders[run][channel], measured=orders[run][other].measured) for run in runs
            ]
            return float(np.median([own.misfit(factor) for own in found]))

        scale = campaign.factor(second) / campaign.factor(
            first
        )  # for columns read in each other's unit
        as_is = off(first, first, 1.0), off(second, second, 1.0)
        exchanged = off(first, second, 1.0 / scale), off(second, first, scale)
        forces, gain = (
            [channel in FORCES for channel in (first, second)],
            sum(exchanged) / sum(as_is),
        )
        near = all(
            left < (0.7 if force else 0.15) for left, force in zip(exchanged, forces, strict=True)
        )
        if min(as_is) > 0.15 and near and gain < (0.5 if any(forces) else 0.3):
            pairs.append((gain, first, second, runs))
    found, taken = [], set()
    for _, first, second, runs in sorted(pairs):
        if not taken & {first, second}:
            taken |= {first, second}
            columns = [campaign.channels[channel].column for channel in (first, second)]
            sentence = (
                f"{first} and {second} are swapped: column {columns[0]} agrees with {second}, and"
                f" column {columns[1]} with {first}; exchange the two columns in the campaign file"
            )
            sides = ((first, second), (second, first))
            found += [
                Contradiction(run, one, "swapped", sentence, other)
                for one, other in sides
                for run in runs
            ]
    return found


def _copied(recordings: Mapping[str, Recording], orders: AllOrders) -> Iterator[Contradiction]:
    """Channels with the samples of another run, for the run that agrees less with the mechanism."""
    for pair in combinations(recordings, 2):
        for name in recordings[pair[0]].channels:
            values, others = (recordings[run].channels[name] for run in pair)
            count = min(values.size, others.size)
            known = np.isfinite(values[:count] + others[:count])
            if (
                np.any(values[:count][known])
                and np.mean((values[:count] == others[:count])[known]) > 0.9
            ):
                known_orders = [run for run in pair if name in orders.get(run, {})]
                wrong = min(
                    known_orders, key=lambda run: orders[run][name].correlation, default=pair[0]
                )
                other = pair[wrong == pair[0]]
                sentence = (
                    f"{name} has the samples of run {other}; give the column measured in this run"
                )
                yield Contradiction(wrong, name, "unrelated", sentence)


def _of_channel(
    campaign: Campaign, channel: str, orders: Mapping[str, Orders]
) -> Iterator[Contradiction]:
    """Contradictions of one channel by run; of forces only those alike in all runs."""
    clear = {run: own for run, own in orders.items() if own.is_clear(0.25)}
    if not clear:
        return
    factors = [own.factor for own in clear.values()]
    alike, common = max(factors) < ALIKE * min(factors), float(np.median(factors))
    least, gains = MIN_CORRELATION, GAINS
    if channel in FORCES:
        least, gains = MIN_CORRELATION_OF_FORCES, GAINS_OF_FORCES
        speeds = [abs(own.speed) for own in clear.values()]
        apart = max(speeds) / min(speeds)
        correlations = [own.correlation for own in clear.values()]
        turned = max(correlations) < -least and gains[0] < common < gains[1] and apart > ALIKE
        if not (
            alike and (turned or (min(correlations) > least and apart > _speeds_apart(common)))
        ):
            return
    for run, own in clear.items():
        factor, correlation = common if alike else own.factor, own.correlation
        if correlation < -least:
            yield _off_by(-own.factor, campaign, run, channel, _REFERENCE)
        elif correlation > least:
            if not gains[0] < factor < gains[1]:
                yield _off_by(factor, campaign, run, channel, _REFERENCE)
        elif not (correlation >= 0.5 and own.factor * correlation >= 0.4):
            sentence = (
                f"{channel} does not match {_REFERENCE} (correlation {correlation:.2f}); check"
                " column and sensor"
            )
            yield Contradiction(run, channel, "unrelated", sentence, factor=own.factor)


def _speeds_apart(factor: float) -> float:
    """Ratio of speeds [1] above which a load proportional to speed cannot explain the same force
    `factor` in all runs: relative to inertia, which grows with the square of the speed, it would
    have to differ by more than `ALIKE` allows.
    """
    loads = abs(factor * sqrt(ALIKE) - 1.0), abs(factor / sqrt(ALIKE) - 1.0)
    return max(loads) / min(loads)
