"""Height of the sun as photos were taken, from their date and place."""

from collections.abc import Mapping
from datetime import UTC, date, datetime, time, timedelta

import numpy as np

from core.block import Block
from core.doubts import Failure
from core.formats.stac import time_span
from core.geometry.crs import degrees_of
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.rules import DOUBTFUL, SOUND, Finding

# source: definition of the epoch J2000.0.
EPOCH = datetime(2000, 1, 1, 12, tzinfo=UTC)
NOON = time(12)  # source: definition.
# source: a day has 24 hours, and the sun passes 360 degrees in it.
HOUR_DEG = 15.0
"""The sun goes so far in an hour, degrees."""


def sun_findings(
    block: Block, exposed: Mapping[str, str], rules: JobRules = USUAL_RULES
) -> tuple[Finding, ...]:
    """Whether the sun stood high enough; nothing where no date or no place on Earth is known.

    Where the time of day is not known, the sun stood no higher than at noon: only a noon below
    the limit is a doubt.

    Args:
        block: Photos with their places.
        exposed: Time of exposure by photo: a year, month or day as ISO has it, or a time with its
            offset from UTC.
        rules: Limits of the job.
    """
    names = [name for name in block.photos if exposed.get(name)]
    centres = np.array([block.photos[name].exterior.centre[:2] for name in names]).reshape(-1, 2)
    places = degrees_of(block.crs, centres)
    heights = {
        name: sun_height_deg(exposed[name], east, north)
        for name, (east, north) in zip(names, places.tolist(), strict=True)
        if np.isfinite([east, north]).all()
    }
    if not heights:
        return ()
    worst = min(heights, key=lambda name: heights[name])
    over = sum(height < rules.sun_deg for height in heights.values())
    told = {"value": f"{heights[worst]:.1f}", "worst": worst, "limit": f"{rules.sun_deg:g}",
            "over": str(over), "count": str(len(heights))}  # fmt: skip
    if over:
        return (Finding("sun-low", DOUBTFUL, told),)
    timed = all(_moment_of(exposed[name]) is not None for name in heights)
    return (Finding("sun" if timed else "sun-noon", SOUND, told),)


def sun_height_deg(exposed: str, longitude_deg: float, latitude_deg: float) -> float:
    """Height of the sun's centre above the horizon, without refraction, degrees.

    Args:
        exposed: A time with its offset from UTC; of a day, month or year the greatest height that
            the sun reaches in it.
        longitude_deg: East of Greenwich.
        latitude_deg: North of the equator.
    """
    moment = _moment_of(exposed)
    if moment is not None:
        return _height_deg(moment, longitude_deg, latitude_deg)
    span = time_span(exposed)
    assert not isinstance(span, Failure), f"{exposed} is no date"
    first, last = span
    days = (first + timedelta(days=number) for number in range((last - first).days + 1))
    return max(_noon_height_deg(day, longitude_deg, latitude_deg) for day in days)


def _moment_of(exposed: str) -> datetime | None:
    """The moment of exposure; None where only a day, a month or a year is known."""
    if "T" not in exposed:
        return None
    moment = datetime.fromisoformat(exposed)
    return moment if moment.tzinfo is not None else None


def _noon_height_deg(day: date, longitude_deg: float, latitude_deg: float) -> float:
    """Height at local noon: what latitude and declination leave of a right angle."""
    noon = datetime.combine(day, NOON, UTC) - timedelta(hours=longitude_deg / HOUR_DEG)
    declination, _ = _equatorial(noon)
    return 90.0 - abs(latitude_deg - float(np.degrees(declination)))


def _height_deg(moment: datetime, longitude_deg: float, latitude_deg: float) -> float:
    declination, right_ascension = _equatorial(moment)
    # source: Astronomical Almanac, section B: Greenwich mean sidereal time, degrees.
    sidereal = 280.46062 + 360.98564737 * _days(moment)
    hour_angle = np.radians(sidereal + longitude_deg) - right_ascension
    latitude = np.radians(latitude_deg)
    sine = np.sin(latitude) * np.sin(declination)
    sine += np.cos(latitude) * np.cos(declination) * np.cos(hour_angle)
    return float(np.degrees(np.arcsin(sine)))


def _days(moment: datetime) -> float:
    """Days since the epoch."""
    return (moment - EPOCH) / timedelta(days=1)


def _equatorial(moment: datetime) -> tuple[float, float]:
    """Declination and right ascension of the sun, radians; good to 0.01 degrees."""
    days = _days(moment)
    # source: Astronomical Almanac, section C, low-precision formulas for the sun, degrees.
    mean_longitude, anomaly = 280.460 + 0.9856474 * days, np.radians(357.528 + 0.9856003 * days)
    # source: the same.
    longitude = mean_longitude + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2 * anomaly)
    # source: the same: obliquity of the ecliptic.
    ecliptic, obliquity = np.radians(longitude), np.radians(23.439 - 4e-7 * days)
    declination = np.arcsin(np.sin(obliquity) * np.sin(ecliptic))
    right_ascension = np.arctan2(np.cos(obliquity) * np.sin(ecliptic), np.cos(ecliptic))
    return float(declination), float(right_ascension)
