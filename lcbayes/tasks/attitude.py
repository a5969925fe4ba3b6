"""The options of tasks that assume a known attitude of the object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.options import Options, option

if TYPE_CHECKING:
    from lcbayes.data.lightcurve import LightCurve
    from lcbayes.physics.attitude.laws import Attitude


@dataclass(frozen=True)
class AttitudeOptions(Options):
    """The attitude: fixed axes, a constant angular velocity, or a pole with a period.

    Attributes
    ----------
    attitude_required : whether an attitude must be given; if not, the default is fixed axes
    """

    attitude_required: ClassVar[bool] = True

    attitude: str | None = option(
        None, choices=("none",), help="none: the body axes are the inertial axes"
    )
    omega: tuple[float, float, float] | None = option(
        None, unit="rad/s", metavar="X,Y,Z", help="constant angular velocity, inertial axes"
    )
    pole: tuple[float, float] | None = option(
        None, unit="deg", metavar="LON,LAT", help="pole of the spin, in the frame of the data"
    )
    period: float | None = option(
        None, unit="hours", metavar="HOURS", help="sidereal period of the spin"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [n for n in ("attitude", "omega", "pole") if getattr(self, n) is not None]
        if len(given) != 1 and (given or self.attitude_required):
            what = (
                " and ".join(f"--{n}" for n in given) + " are given" if given else "none is given"
            )
            raise InputError(
                f"one attitude is needed, and {what}; give --pole LON,LAT with --period HOURS, "
                "--omega X,Y,Z, or --attitude none"
            )
        if (self.pole is None) != (self.period is None):
            raise InputError("a spin needs both --pole LON,LAT and --period HOURS")

    def known_attitude(self, curve: LightCurve) -> Attitude:
        """The attitude; fixed axes if none is given and none is required.

        The phase of a spin is zero at the middle of the data.
        """
        from lcbayes.physics.attitude.laws import ConstantRate, Fixed, PrincipalAxis

        if self.omega is not None:
            return ConstantRate(self.omega)
        if self.pole is None or self.period is None:
            return Fixed()
        lon, lat = self.pole
        middle = 0.5 * float(curve.t.max() - curve.t.min())
        return PrincipalAxis(lon, lat, HOUR_S * self.period, t0_s=middle)

    def attitude_settings(self) -> dict[str, Any]:
        """The attitude as stored in ``summary.json``."""
        if self.omega is not None:
            return {"omega": self.omega}
        if self.pole is None:
            return {}
        lon, lat = self.pole
        return {"pole_lon_deg": lon, "pole_lat_deg": lat, "period_h": self.period}
