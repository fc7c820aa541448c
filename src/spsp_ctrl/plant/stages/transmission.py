"""Transmission stage: motor angle and rod length -> rod force."""

from __future__ import annotations

from math import pi

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects.axial_compliance import softened
from spsp_ctrl.plant.effects.backlash import contact_force
from spsp_ctrl.plant.effects.base import stage
from spsp_ctrl.plant.effects.lead_error import screw_travel
from spsp_ctrl.plant.effects.thermal_expansion import elongation
from spsp_ctrl.plant.layout import A, G, X


@stage
def free_travel(x: Array, xb: int, p: Array, pb: int) -> tuple[float, float]:
    """Travel of the nut from level without gap and load (m), and its derivative by the motor angle (m/rad)."""
    gear = p[pb + A.gear_ratio]
    travel, gain = screw_travel(
        x[xb + X.angle] / gear,
        p[pb + A.screw_lead_m] / (2.0 * pi),
        p[pb + A.lead_slope],
        p[pb + A.lead_first_m],
        p[pb + A.lead_first_phase_rad],
        p[pb + A.lead_second_m],
        p[pb + A.lead_second_phase_rad],
    )
    travel += p[pb + A.zero_offset_m] + elongation(
        x[xb + X.screw_temperature],
        p[G.temperature_reference_c],
        p[pb + A.screw_expansion_1_k],
        p[pb + A.screw_length_m],
    )
    return travel, gain / gear


@stage
def rod_force(travel: float, travel_rate: float, rod: float, rod_rate: float, p: Array, pb: int) -> float:
    """Force that the screw puts into the rod in N, positive pushes the platform up."""
    return contact_force(
        travel - rod,
        travel_rate - rod_rate,
        p[pb + A.gap_m],
        softened(p[pb + A.axial_stiffness_n_m], p[pb + A.added_compliance_m_n]),
        p[pb + A.contact_damping_n_s_m],
    )


@stage
def stop_force(rod: float, rod_rate: float, p: Array, pb: int) -> float:
    """Force of the hard stops on the rod in N."""
    low = p[pb + A.rod_min_m]
    high = p[pb + A.rod_max_m]
    if rod > high:
        force = -p[G.stop_stiffness_n_m] * (rod - high) - p[G.stop_damping_n_s_m] * rod_rate
        return force if force < 0.0 else 0.0
    if rod < low:
        force = p[G.stop_stiffness_n_m] * (low - rod) - p[G.stop_damping_n_s_m] * rod_rate
        return force if force > 0.0 else 0.0
    return 0.0
