//! What every key means, for `daemon config` and for messages.

use observer::Parameter;

/// The comment line above a key.
pub(super) fn comment(key: &str) -> String {
    // The keys of a solver mean the same in every channel.
    let in_any_channel = key.split_once('.').map_or("", |(_, name)| name);
    match KEYS.iter().find(|(known, _)| *known == key || *known == in_any_channel) {
        Some((_, text)) => format!("# {text}\n"),
        None => String::new(),
    }
}

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

/// What every key means, for `daemon config` and for messages.
pub(super) const KEYS: &[(&str, &str)] = &[
    ("rate_hz", "Ticks per second; each publishes one estimate."),
    ("trigger", "When to step: \"timer\" at rate_hz, or \"sample\" as soon as one arrives (polls one core)."),
    (
        "clock",
        "Time of the estimate: \"monotonic\" (now), or \"samples\" (stamp of the newest sample; replay at another speed).",
    ),
    (
        "spin_us",
        "The last microseconds of every wait are spent polling the clock: less lateness for more of a core.",
    ),
    ("stale_after_s", "Without a sample for this long, the estimate's status says stale."),
    (
        "initial",
        "The state before the first sample; what is missing is taken from the first measurement of it.",
    ),
    ("initial.position_m", "Position, inertial."),
    ("initial.velocity_m_s", "Velocity, inertial."),
    ("initial.attitude_wxyz", "Attitude, unit quaternion, body to inertial."),
    ("initial.angular_velocity_rad_s", "Angular velocity, body axes."),
    ("input", "Which samples are believed, and from which source."),
    ("input.max_speed_m_s", "A faster measured velocity is rejected; a faster estimate is reset."),
    ("input.max_angular_rate_rad_s", "A faster measured rotation is rejected; a faster estimate is reset."),
    ("input.max_position_m", "A position further from the origin is rejected; such an estimate is reset."),
    ("input.max_force_n", "A larger commanded force is rejected."),
    ("input.max_torque_n_m", "A larger commanded torque is rejected."),
    (
        "input.max_unknown_force_n",
        "A larger learned force is not believed: the translation is reset to its last good copy.",
    ),
    (
        "input.max_unknown_torque_n_m",
        "A larger learned torque is not believed: the rotation is reset to its last good copy.",
    ),
    ("input.max_output", "An output of the linear plant with a larger entry is rejected."),
    (
        "input.max_input",
        "A commanded input of the linear plant with a larger entry is rejected; a learned one is reset.",
    ),
    ("input.max_state", "A state of the linear plant with a larger entry is reset to its last good copy."),
    ("input.max_future_s", "A stamp further ahead of the clock is rejected."),
    ("input.max_age_s", "A stamp further behind the clock is rejected."),
    (
        "input.source",
        "Where several publish: \"first\" keeps the one in use, \"newest\" takes the one that appeared last.",
    ),
    ("input.takeover_after_s", "A source silent for this long may be replaced by another one."),
    (
        "input.outliers",
        "An output whose error stands out: \"off\" believes it, \"adaptation\" does not learn from it, \"correction\" does not use it. What lasts longer than 10 holds is believed.",
    ),
    (
        "input.outlier_factor",
        "It stands out if its error is this many times the dead zone's width plus the running scale of the errors.",
    ),
    (
        "input.stuck",
        "A sensor that repeats one value to the bit is named, and its outputs: \"off\" are used, \"adaptation\" not learned from, \"correction\" not used.",
    ),
    ("input.stuck_after_samples", "Repetitions after which a sensor is stuck; 0 is never."),
    ("deadline", "What happens when ticks end after their next deadline, so many in a row; 0 is never."),
    ("deadline.warn_after_ticks", "The estimate's status says late."),
    (
        "deadline.predict_only_after_ticks",
        "Samples are not used any more, which costs less, until a tick is in time again.",
    ),
    ("deadline.invalid_after_ticks", "The estimate's status says invalid: not to be used."),
    ("snapshot", "What is written down, so that nothing learned is lost."),
    ("snapshot.save_every_s", "Time between two snapshots; 0 writes one on command and at the end only."),
    (
        "snapshot.resume_state_within_s",
        "After a restart the state in a snapshot is gone on from where it is not older than this; what was learned always is.",
    ),
    (
        "solver",
        "How the learned function is computed: \"dense\" from all centers, exact; \"local\" from those around the output, with an error estimate in every estimate; \"auto\" by the number of centers. Or a table of options.",
    ),
    ("solver.kind", "\"auto\", \"dense\" or \"local\"."),
    (
        "solver.block",
        "Local: centers along each axis of the lattice block that is evaluated, an even number 4 … 12; default: as accuracy needs.",
    ),
    (
        "solver.accuracy",
        "Local: the error that the block is chosen for, RMS relative to the learned function, for random updates.",
    ),
    (
        "solver.truncation",
        "Local: an update ends where the kernel falls below this multiple of its largest value; 0 never cuts (Wendland kernels end by themselves).",
    ),
    (
        "real_time",
        "What the loop asks of the system, with priority = 1 … 98 and cores = [2] too; what is refused is said, and done without (daemon doctor).",
    ),
    (
        "real_time.priority",
        "SCHED_FIFO with this priority, 1 … 98, for the loop's thread alone; absent: scheduled like any other.",
    ),
    (
        "real_time.cores",
        "Cores of the loop's thread, as [2]; the service's other threads stay off them. Absent: all.",
    ),
    ("real_time.lock_memory", "Lock all memory, so that none is swapped out or mapped late."),
    (
        "real_time.awake_cores",
        "No core of the machine enters an idle state that takes time to leave; costs power.",
    ),
    ("real_time.required", "Refuse to start when something of this is refused (as --require-real-time)."),
    ("translation", "Position, velocity and unknown force from measured velocity."),
    ("translation.mass_kg", "Nominal mass; under water with the added mass."),
    (
        "translation.gravity_m_s2",
        "Gravity along the inertial axes where the commanded force carries the weight; [0, 0, 9.81] with axes north-east-down.",
    ),
    ("translation.known_force_n", "Another known constant force along the inertial axes, buoyancy say."),
    (
        "translation.sample_rate_hz",
        "Velocity measurements per second (default rate_hz); each is held for 1.5 periods, then the channel coasts.",
    ),
    ("translation.gain_per_s", "Observer gain λ: how fast the velocity estimate follows the measurement."),
    (
        "translation.adaptation_rate_kg_s2",
        "Adaptation rate Γ_f: a number, three numbers (diagonal) or 3 × 3.",
    ),
    (
        "translation.kernel",
        "Kernel κ: \"sobolev-matern-K\" (an order K above half the number of outputs: the higher, the smoother what is learned), \"gaussian\", \"wendland-c2\", \"wendland-c4\".",
    ),
    (
        "translation.length_scale_m_s",
        "Length scale ℓ of the kernel: speeds this far apart share what is learned. One number, or one per axis.",
    ),
    ("translation.centers_lower_m_s", "Lower corner of the lattice of kernel centers, in velocity."),
    ("translation.centers_upper_m_s", "Upper corner of the lattice of kernel centers, in velocity."),
    ("translation.centers_per_axis", "Centers along each axis of the lattice."),
    ("translation.centers_listed_m_s", "Centers one by one, instead of a lattice."),
    (
        "translation.nugget",
        "Added to the Gram matrix's diagonal as a multiple of κ(0); 0 is the paper's law.",
    ),
    (
        "translation.dead_zone",
        "Shape of the dead zone σ: \"saturated\", \"quadratic\" (the paper's, corrected) or \"step\" (Theorem 1; ignores the buffer).",
    ),
    ("translation.dead_zone_width_m_s", "Dead zone d: output errors up to this are taken for noise."),
    ("translation.dead_zone_buffer_m_s", "Buffer ε over which the dead zone opens."),
    ("translation.noise_bound_m_s", "Bound δ̄ on the norm of the velocity measurement's error."),
    (
        "translation.unmatched_force_bound_n",
        "Bound ξ̄ on the force that is no function of the velocity (gusts); it widens the guarantees, not the estimate.",
    ),
    (
        "translation.residual_norm_bound_n",
        "Bound r_f on the native norm of what the centers cannot represent of the unknown force; it widens the guarantees.",
    ),
    (
        "translation.velocity_error_to_position",
        "Gain L_r of the velocity error into the position; 0 is dead reckoning.",
    ),
    ("translation.position_fix_gain_per_s", "Gain L_p of position fixes; 0 uses only the first one."),
    ("translation.position_fix_hold_s", "How long a position fix keeps correcting."),
    ("rotation", "Attitude, angular velocity and unknown torque from measured angular velocity."),
    ("rotation.inertia_kg_m2", "Nominal inertia: a number, three numbers (diagonal) or 3 × 3."),
    (
        "rotation.gyroscopic_torque",
        "−ω × Iω: \"learned\" with the rest (the paper), or \"feedforward\" from the estimate.",
    ),
    (
        "rotation.sample_rate_hz",
        "Angular-velocity measurements per second (default rate_hz); each is held for 1.5 periods, then the channel coasts.",
    ),
    (
        "rotation.gain_per_s",
        "Observer gain λ: how fast the angular-velocity estimate follows the measurement.",
    ),
    ("rotation.adaptation_rate_n_m", "Adaptation rate Γ_f: a number, three numbers (diagonal) or 3 × 3."),
    (
        "rotation.kernel",
        "Kernel κ: \"sobolev-matern-K\" (an order K above half the number of outputs: the higher, the smoother what is learned), \"gaussian\", \"wendland-c2\", \"wendland-c4\".",
    ),
    (
        "rotation.length_scale_rad_s",
        "Length scale ℓ of the kernel: rates this far apart share what is learned. One number, or one per axis.",
    ),
    ("rotation.centers_lower_rad_s", "Lower corner of the lattice of kernel centers, in angular velocity."),
    ("rotation.centers_upper_rad_s", "Upper corner of the lattice of kernel centers, in angular velocity."),
    ("rotation.centers_per_axis", "Centers along each axis of the lattice."),
    ("rotation.centers_listed_rad_s", "Centers one by one, instead of a lattice."),
    ("rotation.nugget", "Added to the Gram matrix's diagonal as a multiple of κ(0); 0 is the paper's law."),
    (
        "rotation.dead_zone",
        "Shape of the dead zone σ: \"saturated\", \"quadratic\" (the paper's, corrected) or \"step\" (Theorem 1; ignores the buffer).",
    ),
    ("rotation.dead_zone_width_rad_s", "Dead zone d: output errors up to this are taken for noise."),
    ("rotation.dead_zone_buffer_rad_s", "Buffer ε over which the dead zone opens."),
    ("rotation.noise_bound_rad_s", "Bound δ̄ on the norm of the angular-velocity measurement's error."),
    (
        "rotation.unmatched_torque_bound_n_m",
        "Bound ξ̄ on the torque that is no function of the angular velocity; it widens the guarantees, not the estimate.",
    ),
    (
        "rotation.residual_norm_bound_n_m",
        "Bound r_f on the native norm of what the centers cannot represent of the unknown torque; it widens the guarantees.",
    ),
    ("rotation.attitude_fix_gain_per_s", "Gain L_q of attitude fixes; 0 uses only the first one."),
    ("rotation.attitude_fix_hold_s", "How long an attitude fix keeps correcting."),
    ("linear", "A general linear plant x' = A x + B (u + f(y)), y = C x, in units of its own."),
    ("linear.a", "A, row after row."),
    ("linear.b", "B, row after row."),
    ("linear.c", "C, row after row: as many outputs as inputs."),
    ("linear.gain", "Observer gain L, row after row; A − LC must be Hurwitz on what is observable."),
    ("linear.state_names", "Names of the states, for reports."),
    (
        "linear.initial_state",
        "The state before the first sample; default: the least one with the first output.",
    ),
    (
        "linear.sample_rate_hz",
        "Outputs per second (default rate_hz); each is held for 1.5 periods, then the channel coasts.",
    ),
    ("linear.adaptation_rate", "Adaptation rate Γ_f: a number, one per output (diagonal), or m × m."),
    (
        "linear.kernel",
        "Kernel κ: \"sobolev-matern-K\" (an order K above half the number of outputs: the higher, the smoother what is learned), \"gaussian\", \"wendland-c2\", \"wendland-c4\".",
    ),
    (
        "linear.length_scale",
        "Length scale ℓ of the kernel: outputs this far apart share what is learned. One number, or one per axis.",
    ),
    ("linear.centers_lower", "Lower corner of the lattice of kernel centers, in the output."),
    ("linear.centers_upper", "Upper corner of the lattice of kernel centers, in the output."),
    ("linear.centers_per_axis", "Centers along each axis of the lattice."),
    ("linear.centers_listed", "Centers one by one, instead of a lattice."),
    ("linear.nugget", "Added to the Gram matrix's diagonal as a multiple of κ(0); 0 is the paper's law."),
    (
        "linear.dead_zone",
        "Shape of the dead zone σ: \"saturated\", \"quadratic\" (the paper's, corrected) or \"step\" (Theorem 1; ignores the buffer).",
    ),
    ("linear.dead_zone_width", "Dead zone d: output errors up to this are taken for noise."),
    ("linear.dead_zone_buffer", "Buffer ε over which the dead zone opens."),
    ("linear.noise_bound", "Bound δ̄ on the norm of the output's measurement error."),
    (
        "linear.unmatched_bound",
        "Bound ξ̄ on what else acts on x' and is no function of the output; it widens the guarantees, not the estimate.",
    ),
    (
        "linear.residual_norm_bound",
        "Bound r_f on the native norm of what the centers cannot represent of the unknown input; it widens the guarantees.",
    ),
];
