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

from jointgap.config.campaign import FILTER_ORDER, UNITS, Campaign, CampaignRun, Channel
from jointgap.config.channels import ChannelKind
from jointgap.core.units import counts_near, split_share, unit_factor
from jointgap.core.words import joined, number
from jointgap.motion.ideal import ideal_orders
from jointgap.rig.recording import Contradiction, Recording
from jointgap.rig.sampling import aperiodic_share, speed_from_periodicity

MAX_ORDER = 4  # Highest crank order compared with the ideal motion
MIN_CORRELATION, MIN_CORRELATION_OF_FORCES = 0.9, 0.8  # Required for a factor between two channels
GAINS, GAINS_OF_FORCES = (0.8, 1.25), (0.5, 2.0)  # Plausible factors by a sensor's gain or a load
# Ratio up to which factors of several runs are equal, and from which speeds are very different
ALIKE = 1.35
MIN_HELD = 8  # Changes of a reading that is held
SEARCHED_TURNS = 20.0  # Turns used to search a speed
PERIOD_TURNS = 4.0  # From which the channels' period is compared with the turn of the crank angle
LEAST_APERIODIC = 0.02  # [1, of each channel's variance] From which another period is tried
LEAST_PERIOD_ERROR = 0.005  # [1] Of a turn; lags of sensors while the speed drifts cause less
_PHASES = np.arange(-180, 180) * (pi / 180)
_REFERENCE = "the value computed from the crank motion"


@dataclass(frozen=True)
class Orders:
    """Low crank orders of a channel in one run: channel [SI] = Re sum C_k exp(i k angle)."""

    kind: ChannelKind
    measured: np.ndarray
    expected: np.ndarray
    error: float  # [SI] Standard error of the measured orders' norm
    variance: float  # [SI] Of the channel
    speed: float  # [rad/s]

    @property
    def factor(self) -> float:
        """Norm of the measured over that of the expected orders."""
        return np.linalg.norm(self.measured) / np.linalg.norm(self.expected)

    @property
    def correlation(self) -> float:
        """Cosine between measured and expected orders; NaN if one is zero."""
        size = np.linalg.norm(self.measured) * np.linalg.norm(self.expected)
        return np.real(np.vdot(self.expected, self.measured)) / size if size else np.nan

    def shifted(self, phase: float) -> "Orders":
        """The same with the expected orders advanced by `phase` [rad]."""
        orders = np.arange(1, self.expected.size + 1)
        return replace(self, expected=self.expected * np.exp(1j * phase * orders))

    @property
    def misfit(self) -> float:
        """Relative distance of the measured from the expected orders."""
        distance = np.linalg.norm(self.measured - self.expected)
        return distance / np.linalg.norm(self.expected)

    def is_clear(self, share: float) -> bool:
        """Whether noise is below a `share` of the measured or expected orders."""
        size = max(np.linalg.norm(self.measured), np.linalg.norm(self.expected))
        return self.error < share * size


AllOrders = Mapping[str, Mapping[str, Orders]]  # By run and channel, of runs with a steady crank


def consistency_checks(
    campaign: Campaign, recordings: Mapping[str, Recording]
) -> list[Contradiction]:
    """Channels that are inconsistent with each other or with the ideal motion."""
    runs = [run for run in campaign.runs if run.id in recordings]
    all_orders, times, periods = {}, [], {}
    for run in runs:
        recording = recordings[run.id]
        if (crank := _crank(campaign, run, recording)) is not None:
            angle, speed, wrong_times = crank
            orders = _orders(campaign, recording, angle, speed)
            all_orders[run.id], unsure = _at_one_clock(run.id, orders, recording.second_clock)
            times += [*wrong_times, *unsure]
            periods[run.id] = _period(campaign, recording, angle, speed)
    if turns := _wrong_turns(campaign, periods):
        return turns  # the other checks presume the angle
    zeros = _encoder_zeros(campaign, all_orders) if "crank_angle" in campaign.channels else {}
    shifted = {
        run: {name: series.shifted(-zeros.get(run, 0.0)) for name, series in orders.items()}
        for run, orders in all_orders.items()
    }
    columns = _swapped(campaign, shifted)
    exchanged = {item.channel for item in columns}
    columns += [item for item in _copied(recordings, all_orders) if item.channel not in exchanged]
    reported = {(item.run, item.channel) for item in columns}
    for name in campaign.channels:
        by_run = {
            run: orders[name]
            for run, orders in shifted.items()
            if name in orders and (run, name) not in reported
        }
        columns += _of_channel(campaign, name, by_run)
    speeds = (item for run in runs for item in _crank_speed(campaign, run, recordings[run.id]))
    return [*times, *speeds, *_wrong_zeros(campaign, all_orders, zeros), *columns]


def _at_one_clock(
    run: str, orders: Mapping[str, Orders], second: Sequence[str]
) -> tuple[dict[str, Orders], list[Contradiction]]:
    """The orders of a run with those expected of the channels of a `second` clock at its most
    likely offset, and a remark if another offset is nearly as likely.
    """
    clear = [series for name, series in orders.items() if name in second and series.is_clear(0.3)]
    if not clear:
        return dict(orders), []
    agreement = np.mean(_correlations(clear), axis=1)
    phase = _PHASES[np.argmax(agreement)]
    apart = np.abs(np.remainder(_PHASES - phase + pi, tau) - pi) > pi / 4
    contradictions = []
    if agreement[apart].max() > 0.95 * agreement.max():
        rival = _PHASES[apart][np.argmax(agreement[apart])]
        offsets = [f"{1e3 * angle / clear[0].speed:.3g} ms" for angle in (phase, rival)]
        sentence = (
            f"the offset of the second file's clock may be {' or '.join(offsets)},"
            f" as {joined(second)} nearly repeats within a revolution; record one channel with both"
            " loggers, or check which one is found"
        )
        contradictions = [Contradiction(run, second[0], "clock", sentence, doubtful=False)]
    shifted = {
        name: series.shifted(-phase) if name in second else series
        for name, series in orders.items()
    }
    return shifted, contradictions


def _correlations(channels: Sequence[Orders]) -> np.ndarray:
    """Correlations (360, channels) of channels delayed by each of `_PHASES`."""
    return np.array(
        [[series.shifted(-phase).correlation for series in channels] for phase in _PHASES]
    )


# Crank motion of one run with the sign of the file: angles [rad], speed [rad/s], inconsistent times
Crank = tuple[np.ndarray, float, list[Contradiction]]


def _crank(campaign: Campaign, run: CampaignRun, recording: Recording) -> Crank | None:
    """The crank motion; None if unknown or unsteady."""
    if not recording.has_angle:
        return _crank_without_encoder(campaign, run, recording, run.side * run.speed)
    angle = run.side * recording.crank_angle
    if not recording.has_time:
        return angle, run.side * run.speed, []
    is_read = np.isfinite(angle)
    # a second logger has samples between those of the encoder
    ends = {"left": np.nan, "right": np.nan}
    angle = np.interp(recording.time, recording.time[is_read], angle[is_read], **ends)
    is_read = np.isfinite(angle)
    time = recording.time[is_read]
    turned = np.abs(angle[is_read] - angle[is_read][0])
    speed = turned[-1] / (time[-1] - time[0])
    quarter = np.interp(time + tau / 4 / speed, time, turned) - turned
    if np.std(quarter[time + tau / 4 / speed <= time[-1]]) > 0.15 * tau / 4:
        return None
    return _timed(campaign, run, recording, angle, run.side * speed)


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
    powers = {name: series.kind.speed_power for name, series in orders.items()}
    rates = [name for name in orders if powers[name] and abs(orders[name].correlation) > 0.5]
    rates = [name for name in rates if not orders[name].kind.force] or rates
    # rates that agree with the stated speed refute the times
    votes = [-log(orders[name].factor) / (powers[name] * ratio) for name in rates]
    kind, fix = "time", "correct one of them"
    if votes and np.median(votes) > 0.5:
        fix = "the other channels agree with the stated speed, so correct the times"
    elif votes:
        kind = "speed"
        fix = "the other channels agree with the times, so correct the stated speed"
    source = "crank_angle" if recording.has_angle else f"the period of {', '.join(orders)}"
    sentence = (
        f"the speed from the times and {source} is {number(60 * abs(speed) / tau)} rpm, but the"
        f" run's speed is {number(60 * run.speed / tau)} rpm; {fix}"
    )
    doubtful = not recording.has_angle or (kind == "time" and bool(votes))
    contradiction = Contradiction(
        run.id, "time", kind, sentence, factor=abs(speed) / run.speed, doubtful=doubtful
    )
    if kind == "time":
        speed = np.copysign(run.speed, speed)
    return angle, speed, [contradiction]


def _crank_without_encoder(
    campaign: Campaign, run: CampaignRun, recording: Recording, nominal_speed: float
) -> Crank | None:
    """The crank at the nominal speed, or at the speed of the channels' period if that agrees much
    better with the ideal motion.
    """
    if campaign.drive != "constant_speed":
        return None
    elapsed = recording.time - recording.time[0]
    part = elapsed <= SEARCHED_TURNS * tau / run.speed
    elapsed[~part] = np.nan
    orders = _orders(campaign, recording, nominal_speed * elapsed, nominal_speed)
    agreement, first_angle = _agreement(orders)
    if orders and agreement <= 0.6:
        values = [recording.channels[name][part] for name in orders]
        speed = speed_from_periodicity(elapsed[part], values, 0.53 * run.speed, 1.9 * run.speed)
        speed = np.copysign(speed, nominal_speed)
        improved, angle = _agreement(_orders(campaign, recording, speed * elapsed, speed))
        if improved >= max(0.5, agreement / 0.6):
            return _timed(campaign, run, recording, speed * elapsed + angle, speed)
    return nominal_speed * elapsed + first_angle, nominal_speed, []


def _agreement(orders: Mapping[str, Orders]) -> tuple[float, float]:
    """Mean share of the variance explained by the ideal motion at the best first angle, and that
    angle [rad]; without forces if there are other channels.
    """
    series_of_all = [*orders.values()]
    channels = [series for series in series_of_all if not series.kind.force] or series_of_all
    phases = np.arange(180) * (tau / 180)
    scores = np.zeros(phases.size)
    for series in channels:
        turning = np.exp(-1j * np.outer(phases, np.arange(1, series.expected.size + 1)))
        projected = np.real(turning @ (series.expected.conj() * series.measured))
        projected /= np.linalg.norm(series.expected)
        scores += np.maximum(projected, 0.0) ** 2 / (2.0 * series.variance) / len(channels)
    best = np.argmax(scores)
    return scores[best], phases[best]


def _orders(
    campaign: Campaign, recording: Recording, angle: np.ndarray, speed: float
) -> dict[str, Orders]:
    """`Orders` of the channels by regression, for the crank angles `angle` (n,) [rad] and the mean
    `speed` [rad/s].

    Forces only at constant speed and without loads besides gravity. As the residual may repeat
    every turn, the error counts the samples of one turn.
    """
    read = angle[np.isfinite(angle)]
    per_turn = read.size * tau / abs(read[-1] - read[0])
    count = int(np.clip(per_turn / 4, 1, MAX_ORDER))
    loads = [effect for effect in campaign.mechanism.effects if effect.name != "gravity"]
    is_loaded = campaign.drive != "constant_speed" or loads or campaign.own_loads
    expected = ideal_orders(campaign.mechanism, speed, count)
    orders = {}
    turning = np.exp(1j * angle)[:, None] ** np.arange(1, count + 1)
    columns = np.column_stack([np.ones(angle.size), turning.real, turning.imag])
    for name, values in recording.channels.items():
        used = np.isfinite(angle) & np.isfinite(values)
        kind = campaign.channel_kinds[name]
        if name not in expected or (kind.force and is_loaded) or used.sum() < 4 * count + 4:
            continue
        x = columns[used]
        y = values[used]
        weights = np.linalg.lstsq(x.T @ x, x.T @ y, rcond=None)[0]
        error = np.std(y - x @ weights) * sqrt(4.0 * count / min(per_turn, y.size))
        frequencies = speed * np.arange(1, count + 1)
        filtered = expected[name] * _response(campaign.channels[name], frequencies)
        if np.linalg.norm(filtered) > 0.0:
            measured = weights[1 : count + 1] - 1j * weights[count + 1 :]
            orders[name] = Orders(kind, measured, filtered, error, np.var(y), speed)
    return orders


def _period(campaign: Campaign, recording: Recording, angle: np.ndarray, speed: float) -> float:
    """Turns of the measured crank angle [1] after which the other channels repeat: 1 unless they
    repeat much better after another angle and agree better with the ideal motion there.
    """
    read = angle[np.isfinite(angle)]
    turned = np.abs(read - read[0])
    if not recording.has_angle or turned[-1] < PERIOD_TURNS * tau:
        return 1.0
    step = max(int(read.size * tau / turned[-1] / 40), 1)
    part = np.flatnonzero(np.isfinite(angle))[turned < SEARCHED_TURNS * tau][::step]
    parts = [values[part] for values in recording.channels.values()]
    parts = [values for values in parts if np.isfinite(values).sum() >= 50]
    elapsed = np.abs(angle[part] - read[0])
    residual = aperiodic_share(1.0, elapsed, parts)
    if residual <= LEAST_APERIODIC * len(parts):
        return 1.0
    ratios = (speed_from_periodicity(elapsed, parts, 0.6, 2.05), 0.25, 4.0)
    least, ratio = min((aperiodic_share(value, elapsed, parts), value) for value in ratios)
    (stated_agreement, _), (agreement, _) = (
        _agreement(_orders(campaign, recording, angle * factor, speed * factor))
        for factor in (1.0, ratio)
    )
    is_better = least < 0.3 * residual and agreement > max(stated_agreement, 0.5)
    return 1.0 / ratio if is_better else 1.0


def _wrong_turns(campaign: Campaign, periods: Mapping[str, float]) -> list[Contradiction]:
    """A crank angle whose turn is no period of the other channels, alike in all runs."""
    values = np.array([*periods.values()])
    if not values.size or np.abs(values - 1.0).min() <= LEAST_PERIOD_ERROR:
        return []
    if np.ptp(values) > LEAST_PERIOD_ERROR * values.min():
        return []
    period = np.median(values)
    unit = campaign.channels["crank_angle"].unit
    sentence = f"the other channels repeat every {period:.4g} turn of crank_angle, not every turn; "
    parts = split_share(unit)[1]
    if counts := counts_near(period * parts):
        sentence += f"did you mean counts_per_turn: {counts} instead of {parts:g}?"
    else:
        sentence += (
            f"check channels.crank_angle.unit = '{unit}', and whether the encoder turns with"
            " the crank"
        )
    return [
        Contradiction(run, "crank_angle", "scale", sentence, factor=1.0 / period) for run in periods
    ]


def _response(channel: Channel, frequencies: np.ndarray) -> np.ndarray:
    """Frequency response (k,) of a channel's filters at `frequencies` (k,) [rad/s]."""
    s = 1j * frequencies
    response = np.ones(frequencies.size)
    if channel.bandwidth is not None:
        from scipy.signal import butter  # slow to load

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
    has_rate = recording.has_angle and recording.has_time
    speed, source = run.speed, "the speed of the run"
    if has_rate:
        ends = np.flatnonzero(np.isfinite(recording.crank_angle))[[0, -1]]
        speed = np.ptp(recording.crank_angle[ends]) / np.ptp(recording.time[ends])
        source = "the rate of crank_angle"
    factor = run.side * np.nanmean(recording.channels["crank_speed"]) / speed
    is_unknown = campaign.drive == "motor" and not recording.has_angle
    if not GAINS[0] < factor < GAINS[1] and (not is_unknown or factor < 0.0):
        yield _off_by(factor, campaign, run.id, "crank_speed", source)
    elif has_rate and campaign.channels["crank_speed"].average is None:
        yield from _held_speed(run.id, recording)


def _held_speed(run: str, recording: Recording) -> Iterator[Contradiction]:
    """Check for speeds that are held for several samples and vary with the rate of the crank
    angle."""
    is_read = np.isfinite(recording.channels["crank_speed"])
    time = recording.time[is_read]
    speed = recording.channels["crank_speed"][is_read]
    changes = np.flatnonzero(np.diff(speed)) + 1
    lengths = np.diff(changes)
    if changes.size < MIN_HELD or lengths.min() < 2 or np.ptp(lengths) > 1 + 0.1 * lengths.max():
        return
    gate = np.mean(np.diff(time[changes]))
    has_angle = np.isfinite(recording.crank_angle)
    angle_over_time = recording.time[has_angle], recording.crank_angle[has_angle]
    correlations = [0.0]
    for shift in np.linspace(0.0, 2.0, 81) * gate:
        ends = time[changes, None] - shift + gate * np.array([-0.5, 0.5])
        rate = np.diff(np.interp(ends, *angle_over_time, np.nan, np.nan), axis=1)[:, 0]
        within = np.isfinite(rate)
        if np.count_nonzero(within) > MIN_HELD // 2 and np.ptp(rate[within]) > 0.0:
            correlations.append(abs(np.corrcoef(rate[within], speed[changes][within])[0, 1]))
    if max(correlations) > MIN_CORRELATION:
        sentence = (
            f"crank_speed is not the rate of crank_angle: it is held for {1e3 * gate:.3g} ms, as"
            f" the mean of a counter; give it the key 'average: {1e3 * gate:.3g} ms', or remove the"
            " channel"
        )
        yield Contradiction(run, "crank_speed", "held", sentence)


def _off_by(
    factor: float, campaign: Campaign, run: str, name: str, reference: str
) -> Contradiction:
    """A channel that is `factor` times its `reference`, with the sign or unit that fits."""
    channel = campaign.channels[name]
    base = campaign.unit(name)
    if factor < 0.0:
        fix = "remove the channel's sign: -1" if channel.sign == -1 else "give the channel sign: -1"
        sentence = (
            f"{name} has the opposite sign of {reference}; check the sensor direction, or {fix}"
        )
        return Contradiction(run, name, "sign", sentence, factor=factor)
    fix = f"channels.{name}.scale = '{channel.scale}'"
    if channel.scale is None:
        fix = "the units of both"
        true_factor = campaign.factor(name) / factor
        for unit in UNITS[base]:
            if abs(unit_factor(unit, base) / true_factor - 1.0) < 0.05:
                fix += (
                    f": did you mean '{unit}' instead of channels.{name}.unit = '{channel.unit}'?"
                )
                break
    sentence = f"{name} is {factor:.4g} times {reference}; check {fix}"
    return Contradiction(run, name, "scale", sentence, factor=factor)


def _encoder_zeros(campaign: Campaign, all_orders: AllOrders) -> dict[str, float]:
    """Large encoder offsets [rad] by run, common to all runs or not.

    A single channel of a single run is no evidence, unless encoder_zero is listed as a nuisance.
    """
    if common := _common_phase(all_orders):
        return dict.fromkeys(all_orders, common)
    least = 1 if "encoder_zero" in campaign.nuisance else 2
    zeros = {
        run: _common_phase({run: orders})
        for run, orders in all_orders.items()
        if sum(not series.kind.force for series in orders.values()) >= least
    }
    return {run: zero for run, zero in zeros.items() if zero}


def _common_phase(all_orders: AllOrders) -> float:
    """Encoder offset [rad] that makes all channels of all runs consistent, if they are not already;
    else 0.

    Forces are used only if there is no other channel.
    """
    clear = [
        (name, series)
        for orders in all_orders.values()
        for name, series in orders.items()
        if series.is_clear(0.3)
    ]
    channels = [series for _, series in clear if not series.kind.force]
    least = MIN_CORRELATION
    if not channels:
        channels = [series for _, series in clear]
        least = MIN_CORRELATION_OF_FORCES
        for force in dict(clear):
            if not _is_unloaded([series for name, series in clear if name == force]):
                return 0.0
    if not channels or any(series.correlation > least for series in channels):
        return 0.0
    correlations = _correlations(channels)
    best = np.argmax(correlations.sum(axis=1))
    phase = _PHASES[best]
    # the analysis identifies a smaller offset
    if correlations[best].min() < least or abs(phase) < 0.5:
        return 0.0
    # a channel with a wrong sign is no evidence of an encoder offset
    scaled = [replace(s, measured=s.measured / s.factor) for s in channels]
    flipped = np.mean([min(s.misfit, replace(s, measured=-s.measured).misfit) for s in scaled])
    shifted = np.mean([series.shifted(-phase).misfit for series in scaled])
    return phase if shifted < 0.7 * flipped else 0.0


def _is_unloaded(runs: list[Orders]) -> bool:
    """Whether a force is about as large as expected in runs at very different speeds."""
    factors = [series.factor for series in runs]
    speeds = [abs(series.speed) for series in runs]
    is_usual = GAINS_OF_FORCES[0] < min(factors) and max(factors) < GAINS_OF_FORCES[1]
    is_alike = max(factors) <= ALIKE * min(factors)
    return is_usual and is_alike and max(speeds) >= ALIKE * min(speeds)


def _wrong_zeros(
    campaign: Campaign, all_orders: AllOrders, zeros: Mapping[str, float]
) -> Iterator[Contradiction]:
    """Encoder zeros [rad] by run outside their listed bounds."""
    low, high = campaign.nuisance.get("encoder_zero", (0.0, 0.0))
    step = _PHASES[1] - _PHASES[0]
    for run, zero in zeros.items():
        if not low - step < zero < high + step:
            runs = [name for name in zeros if zeros[name] == zero]
            channels = sorted({channel for name in runs for channel in all_orders[name]})
            sentence = (
                f"crank_angle has a wrong zero: {', '.join(channels)} are consistent if it reads"
                f" {degrees(zero):.0f} deg too much; correct it, or check whether encoder_offset is"
                " identified"
            )
            yield Contradiction(run, "crank_angle", "phase", sentence, phase=zero)


def _swapped(campaign: Campaign, all_orders: AllOrders) -> list[Contradiction]:
    """Pairs of channels with exchanged columns: both deviate by more than 15 %, and by less when
    exchanged."""
    pairs = []
    for pair in combinations(campaign.channels, 2):
        a, b = pair
        shared = [orders for orders in all_orders.values() if a in orders and b in orders]
        if not shared:
            continue

        def misfit(channel: str, column: str, scale: float = 1.0, shared=shared) -> float:
            read = [
                replace(orders[channel], measured=scale * orders[column].measured)
                for orders in shared
            ]
            return np.median([series.misfit for series in read])

        scale = campaign.factor(b) / campaign.factor(a)  # each column is read in the other's unit
        as_is = misfit(a, a), misfit(b, b)
        exchanged = misfit(a, b, 1.0 / scale), misfit(b, a, scale)
        are_forces = [campaign.channel_kinds[name].force for name in pair]
        gain = sum(exchanged) / sum(as_is)
        is_near = all(
            value < (0.7 if is_force else 0.15)
            for value, is_force in zip(exchanged, are_forces, strict=True)
        )
        if min(as_is) > 0.15 and is_near and gain < (0.5 if any(are_forces) else 0.3):
            pairs.append((gain, pair))
    contradictions = []
    reported = set()
    for _, pair in sorted(pairs):
        if reported.isdisjoint(pair):
            reported |= {*pair}
            (a, b), columns = pair, [campaign.channels[name].column for name in pair]
            sentence = (
                f"{a} and {b} are swapped: column {columns[0]} agrees with {b}, and"
                f" column {columns[1]} with {a}; exchange the two columns in the campaign file"
            )
            contradictions += [
                Contradiction(run, channel, "swapped", sentence, partner)
                for channel, partner in (pair, pair[::-1])
                for run, orders in all_orders.items()
                if a in orders and b in orders
            ]
    return contradictions


def _copied(recordings: Mapping[str, Recording], all_orders: AllOrders) -> Iterator[Contradiction]:
    """Channels with the samples of another run, for the run that agrees less with the mechanism."""
    for pair in combinations(recordings, 2):
        for name in recordings[pair[0]].channels:
            columns = [recordings[run].channels[name] for run in pair]
            count = min(column.size for column in columns)
            values, copy = (column[:count] for column in columns)
            are_read = np.isfinite(values + copy)
            if np.any(values[are_read]) and np.mean((values == copy)[are_read]) > 0.9:
                checked = [run for run in pair if name in all_orders.get(run, {})]
                wrong = min(
                    checked, key=lambda run: all_orders[run][name].correlation, default=pair[0]
                )
                sentence = (
                    f"{name} has the samples of run {pair[wrong == pair[0]]}; give the column"
                    " measured in this run"
                )
                yield Contradiction(wrong, name, "unrelated", sentence)


def _of_channel(
    campaign: Campaign, channel: str, by_run: Mapping[str, Orders]
) -> Iterator[Contradiction]:
    """Contradictions of one channel by run; of forces only those alike in all runs."""
    clear = {run: orders for run, orders in by_run.items() if orders.is_clear(0.25)}
    if not clear:
        return
    factors = [orders.factor for orders in clear.values()]
    is_alike = max(factors) < ALIKE * min(factors)
    common = np.median(factors)
    least, gains = MIN_CORRELATION, GAINS
    if campaign.channel_kinds[channel].force:
        least, gains = MIN_CORRELATION_OF_FORCES, GAINS_OF_FORCES
        speeds = [abs(orders.speed) for orders in clear.values()]
        apart = max(speeds) / min(speeds)
        correlations = [orders.correlation for orders in clear.values()]
        is_opposite = max(correlations) < -least and gains[0] < common < gains[1]
        is_opposite = is_opposite and apart > ALIKE
        is_scaled = min(correlations) > least and apart > _speeds_apart(common)
        if not (is_alike and (is_opposite or is_scaled)):
            return
    for run, orders in clear.items():
        factor = common if is_alike else orders.factor
        correlation = orders.correlation
        if correlation < -least:
            yield _off_by(-orders.factor, campaign, run, channel, _REFERENCE)
        elif correlation > least:
            if not gains[0] < factor < gains[1]:
                yield _off_by(factor, campaign, run, channel, _REFERENCE)
        elif not (correlation >= 0.5 and orders.factor * correlation >= 0.4):
            sentence = (
                f"{channel} does not match {_REFERENCE} (correlation {correlation:.2f}); check"
                " column and sensor"
            )
            yield Contradiction(run, channel, "unrelated", sentence, factor=orders.factor)


def _speeds_apart(factor: float) -> float:
    """Ratio of speeds [1] above which a load proportional to speed cannot explain the same force
    `factor` in all runs: relative to inertia, which grows with the square of the speed, it would
    have to differ by more than `ALIKE` allows.
    """
    loads = abs(factor * sqrt(ALIKE) - 1.0), abs(factor / sqrt(ALIKE) - 1.0)
    return max(loads) / min(loads)
