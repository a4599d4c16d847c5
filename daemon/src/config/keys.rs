//! Which key sets which parameter of a design.

use observer::Parameter;

/// The key that sets a parameter of the design.
pub(super) fn key_of(table: &str, parameter: Parameter) -> &'static str {
    let pick = |translation, rotation, linear| match table {
        "translation" => translation,
        "rotation" => rotation,
        _ => linear,
    };
    match parameter {
        Parameter::LengthScale => pick("length_scale_m_s", "length_scale_rad_s", "length_scale"),
        Parameter::Nugget => "nugget",
        Parameter::Solver => "solver",
        Parameter::Centers => pick("centers_lower_m_s", "centers_lower_rad_s", "centers_lower"),
        Parameter::Gain => pick("gain_per_s", "gain_per_s", "gain"),
        Parameter::AdaptationRate => pick("adaptation_rate_kg_s2", "adaptation_rate_n_m", "adaptation_rate"),
        Parameter::Inertia => pick("mass_kg", "inertia_kg_m2", "a"),
        Parameter::DeadZoneWidth => pick("dead_zone_width_m_s", "dead_zone_width_rad_s", "dead_zone_width"),
        Parameter::DeadZoneBuffer => {
            pick("dead_zone_buffer_m_s", "dead_zone_buffer_rad_s", "dead_zone_buffer")
        }
        Parameter::NoiseBound => pick("noise_bound_m_s", "noise_bound_rad_s", "noise_bound"),
        Parameter::UnmatchedBound => {
            pick("unmatched_force_bound_n", "unmatched_torque_bound_n_m", "unmatched_bound")
        }
        Parameter::ResidualNorm => {
            pick("residual_norm_bound_n", "residual_norm_bound_n_m", "residual_norm_bound")
        }
        Parameter::Kernel => "kernel",
        Parameter::Hold | Parameter::CoastStep => "sample_rate_hz",
        Parameter::Fix => pick("position_fix_gain_per_s", "attitude_fix_gain_per_s", ""),
        Parameter::Channels => "",
        Parameter::Plant => "a",
        Parameter::PlantInput => "b",
        Parameter::PlantOutput => "c",
        Parameter::InitialState => "initial_state",
    }
}
