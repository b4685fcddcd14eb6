"""The settings of the calibration."""

from typing import Literal

from pydantic import Field

from omnivert.config.section import Section


class Calibration(Section):
    """Odometry and bearings -> mount (VII-VIII)."""

    mode: Literal["default", "paper"] = "default"
    """paper: the filter as printed (state D, eq. 26, 5 K, started from `start_*`); default: global start, 1/D, arcs."""
    start_phi_rad: float = Field(0.0, ge=-3.15, le=3.15)
    """Direction of the camera, measured by hand; used in paper mode only, as are the next two (IX-B)."""
    start_rho_m: float = Field(0.2, ge=0.0, le=5.0)
    """Its distance from the robot's origin."""
    start_psi_rad: float = Field(0.0, ge=-3.15, le=3.15)
    """Its heading, against that direction."""
    max_rho_m: float = Field(1.0, gt=0.0, le=10.0)
    """A camera farther than this from the robot's origin is no solution."""
    sigma_limit_deg: float = Field(2.0, gt=0.0, le=45.0)
    """phi and psi are calibrated when their sigma is below this."""
    sigma_limit_m: float = Field(0.010, gt=0.0, le=1.0)
    """rho is calibrated when its sigma is below this."""
    bearing_floor_deg: float = Field(0.05, gt=0.0, le=10.0)
    """No bearing is believed to be better than this."""
    frame_lines: int = Field(100, ge=10, le=2000)
    """Lines that a frame gives, those followed longest, all around: the time for a frame and for a solve goes by it."""
    invalid_inliers: float = Field(0.7, ge=0.0, le=1.0)
    """When the best solution explains less than this share of the bearings, data and model contradict each other."""
    keyframe_step_m: float = Field(0.015, gt=0.0, le=10.0)
    """Bearings count again after this way, or after `keyframe_turn_deg`: a robot that stands learns nothing new."""
    keyframe_turn_deg: float = Field(1.0, gt=0.0, le=90.0)
    """Or after this turn."""
    window_keyframes: int = Field(600, ge=40, le=5000)
    """Keyframes that are solved together; then the older half becomes a prior of the rest."""
    window_lines: int = Field(200, ge=10, le=5000)
    """Lines of a window, those seen most often."""
    start_etas: int = Field(4, ge=1, le=60)
    """Directions of the camera, phi + psi, that the global start follows up."""
    start_lines: int = Field(60, ge=5, le=5000)
    """Lines used for it, those seen most often."""
    max_disagreement: float = Field(25.0, gt=0.0, le=1e6)
    """Chi-square of 3 degrees of freedom by which the two halves of a drive may differ for a claim."""
    clear_gap: float = Field(25.0, ge=0.0, le=1e6)
    """A solution is clear when any different one is worse by this in -2 log likelihood."""
    clear_inliers: float = Field(0.9, gt=0.0, le=1.0)
    """A solution is clear when this share of the bearings agrees with it."""
    time_offset: Literal["auto", "free", "held"] = "auto"
    """How late the camera's stamps are against the wheels': freed when the drive shows it, always, or never."""
    wheel_ratio: Literal["auto", "free", "held"] = "auto"
    """Right wheel's diameter : left wheel's, against what is configured (1)."""
    wheel_base: Literal["auto", "free", "held"] = "auto"
    """Wheel base, in the unit of the wheels' way: bearings alone do not show the common scale of both wheels."""
    free_time_s: float = Field(0.010, gt=0.0, le=1.0)
    """The time offset is freed when its sigma is below this, or when it is 4 sigma from nothing."""
    free_ratio: float = Field(0.005, gt=0.0, le=1.0)
    """The same of the wheel ratio."""
    free_base: float = Field(0.005, gt=0.0, le=1.0)
    """The same of the base, as a share of the configured one."""
    max_filter_off: float = Field(4.0, gt=0.0, le=1e6)
    """Sigmas by which filter and smoother may differ for a claim."""
    hold_limits: float = Field(1.25, ge=1.0, le=10.0)
    """A claim once made holds until a sigma is this many times its limit: so that it does not flicker."""
    usable_limits: float = Field(5.0, ge=1.0, le=1000.0)
    """A parameter is usable when its sigma is at most this many times its limit."""
    steady_keyframes: int = Field(24, ge=0, le=10_000)
    """Nothing is claimed before results have agreed with each other over so many keyframes."""
    lean_limits: float = Field(1.0, ge=1.0, le=1000.0)
    """No parameter is calibrated while the sigma of another is more than this many times its limit."""
    apart_sigmas: float = Field(3.0, gt=0.0, le=100.0)
    """How far the camera must be from the axis, or from the centre of a circle, to be told from one that sits there."""
    longest_straight_m: float = Field(1.5, ge=0.1, le=20.0)
    """No manoeuvre that is asked for goes straight farther than this: what the room allows."""
    longest_turn_deg: float = Field(180.0, ge=10.0, le=360.0)
    """Nor turns farther than this at once: what a cable allows."""
    alarm_chance: float = Field(1e-7, ge=1e-30, le=0.01)
    """Of a false alarm at a frame that the camera has moved; a smaller one asks for more before a knock is said."""
    noise: Literal["auto", "held"] = "auto"
    """K and the bearings' sigmas are replaced where the residuals say clearly that they are others, or never."""
    resume: bool = True
    """Take up the stored extrinsics at the start, when robot, camera and configuration match."""
