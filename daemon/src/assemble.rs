//! Makes observers of a configuration: its values become designs, which are checked and built.
//!
//! An error names the key, its line, what was found and what would be accepted.

use crate::config::{
    CommonKeys, ConfigError, ConfigFile, DeadZoneName, FeaturesAtName, ForceAxesName, GyroscopicTorqueName,
    InputConfig, KernelName, KeyNames, LawName, LengthScaleConfig, LinearConfig, OutlierAction,
    RotationConfig, SolverConfig, SolverName, SolverOptions, SquareMatrix, SymmetricMatrix,
    TranslationConfig,
};
use crate::estimator::Estimator;
use nalgebra::{DMatrix, DVector, Matrix3, Quaternion, UnitQuaternion, Vector3};
use observer::{
    AccelerometerDesign, BodyAxesDesign, Centers, ChannelDesign, DeadZone, DeadZoneShape, DesignError,
    DisturbanceBounds, ExcitationDesign, FeaturePoint, GradientOptions, GyroscopicTorque, InitialState,
    InnovationGate, JointChannelDesign, JointDesign, JointRotationDesign, JointTranslationDesign, Kernel,
    LengthScale, LinearDesign, LinearObserver, LocalSolver, Parameter, PriorDeviations, RigidBodyObserver,
    RotationDesign, RotationLaw, Solver, TranslationDesign, TranslationLaw,
};

/// An output is held for this many of its sample periods; then its channel coasts.
const HOLD_PERIODS: f64 = 1.5;
/// Peak memory of the local solver's set-up for each center, measured with a million centers.
const BYTES_PER_CENTER: u64 = 80;

/// Checks every value and builds the observers of the service.
///
/// # Errors
/// The key, its line, what was found and what would be accepted.
pub fn estimator(file: &ConfigFile) -> Result<Estimator, ConfigError> {
    check(file)?;
    let config = &file.config;
    let linear = linear_design(file)?.map(|design| LinearObserver::new(&design)).transpose();
    let linear = linear.map_err(|error| refusal(file, "linear", &error))?;
    let rigid_body = match (&linear, &config.translation, &config.rotation) {
        (Some(_), None, None) => None,
        _ => Some(rigid_body(file)?),
    };
    let mut estimator = Estimator { rigid_body, linear };
    let InputConfig { outliers, outlier_factor: factor, .. } = config.input;
    let outliers = match outliers {
        OutlierAction::Off => observer::OutlierAction::Off,
        OutlierAction::Adaptation => observer::OutlierAction::Adaptation,
        OutlierAction::Correction => observer::OutlierAction::Correction,
    };
    estimator.set_innovation_gate(InnovationGate { outliers, factor });
    Ok(estimator)
}

/// Checks every value and builds the observer of the rigid body.
///
/// # Errors
/// As [`estimator`].
pub fn rigid_body(file: &ConfigFile) -> Result<RigidBodyObserver, ConfigError> {
    check(file)?;
    let initial = initial_state(file)?;
    let (translation, rotation) = (translation_design(file)?, rotation_design(file)?);
    // One channel at a time, so that an error can name its table.
    if let Some(design) = &translation {
        RigidBodyObserver::new(Some(design.clone()), None, initial)
            .map_err(|error| refusal(file, "translation", &error))?;
    }
    RigidBodyObserver::new(translation, rotation, initial).map_err(|error| match error.parameter {
        Parameter::Channels => ConfigError {
            place: file.name().to_owned(),
            what: "neither [translation] nor [rotation] nor [linear]; needed: at least one of these tables"
                .into(),
        },
        _ => refusal(file, "rotation", &error),
    })
}

/// The design of the translation, if there is one. Its stability is not checked here.
///
/// # Errors
/// As [`estimator`].
pub fn translation_design(file: &ConfigFile) -> Result<Option<TranslationLaw>, ConfigError> {
    let rate_hz = file.config.rate_hz;
    let design = file.config.translation.as_ref().map(|keys| match keys.law {
        LawName::Gradient => translation(keys, rate_hz).map(TranslationLaw::Gradient),
        LawName::Joint => joint_translation(keys, rate_hz).map(TranslationLaw::Joint),
    });
    design.transpose().map_err(|error| refusal(file, "translation", &error))
}

/// The design of the rotation, if there is one. Its stability is not checked here.
///
/// # Errors
/// As [`estimator`].
pub fn rotation_design(file: &ConfigFile) -> Result<Option<RotationLaw>, ConfigError> {
    let rate_hz = file.config.rate_hz;
    let design = file.config.rotation.as_ref().map(|keys| match keys.law {
        LawName::Gradient => rotation(keys, rate_hz).map(RotationLaw::Gradient),
        LawName::Joint => joint_rotation(keys, rate_hz).map(RotationLaw::Joint),
    });
    design.transpose().map_err(|error| refusal(file, "rotation", &error))
}

/// The design of the linear plant, if there is one. Its stability is not checked here.
///
/// # Errors
/// As [`estimator`].
pub fn linear_design(file: &ConfigFile) -> Result<Option<LinearDesign>, ConfigError> {
    let design = file.config.linear.as_ref().map(|keys| linear(keys, file.config.rate_hz));
    design.transpose().map_err(|error| refusal(file, "linear", &error))
}

/// Checks what needs no observer: bounds, combinations, and that lattices fit into memory.
///
/// # Errors
/// As [`estimator`].
pub fn check(file: &ConfigFile) -> Result<(), ConfigError> {
    file.check()?;
    check_memory(file, free_memory_bytes())
}

/// The error of a refused design, with the key of `table` that sets the refused parameter.
pub fn refusal(file: &ConfigFile, table: &str, error: &DesignError) -> ConfigError {
    let names = match table {
        "translation" => TranslationConfig::NAMES,
        "rotation" => RotationConfig::NAMES,
        _ => LinearConfig::NAMES,
    };
    let key = format!("{table}.{}", key_of(&names, error.parameter));
    file.refusal(&key, &error.found, &error.needed)
}

fn key_of(names: &KeyNames, parameter: Parameter) -> &'static str {
    match parameter {
        Parameter::Kernel => "kernel",
        Parameter::LengthScale => names.length_scale,
        Parameter::Nugget => "nugget",
        Parameter::Solver => "solver",
        Parameter::Centers => names.centers_lower,
        Parameter::Gain => names.gain,
        Parameter::AdaptationRate => names.adaptation_rate,
        Parameter::Inertia => names.inertia,
        Parameter::DeadZoneWidth => names.dead_zone_width,
        Parameter::DeadZoneBuffer => names.dead_zone_buffer,
        Parameter::NoiseBound => names.noise_bound,
        Parameter::UnmatchedBound => names.unmatched_bound,
        Parameter::ResidualNorm => names.residual_norm_bound,
        Parameter::MaxNorm => names.max_native_norm,
        Parameter::Hold | Parameter::CoastStep => "sample_rate_hz",
        Parameter::Fix => names.fix_gain,
        Parameter::Channels => "",
        Parameter::Plant => "a",
        Parameter::PlantInput => "b",
        Parameter::PlantOutput => "c",
        Parameter::InitialState => "initial_state",
        Parameter::Joint(field) => names.joint_key(field),
    }
}

/// A lattice that does not fit into memory would end the process without a message.
fn check_memory(file: &ConfigFile, free_bytes: Option<u64>) -> Result<(), ConfigError> {
    let Some(free_bytes) = free_bytes else { return Ok(()) };
    let config = &file.config;
    let channels = [
        ("translation", config.translation.as_ref().map(TranslationConfig::common)),
        ("rotation", config.rotation.as_ref().map(RotationConfig::common)),
        ("linear", config.linear.as_ref().map(LinearConfig::common)),
    ];
    for (table, keys) in channels {
        let per_axis = keys.and_then(|keys| keys.centers_per_axis).unwrap_or_default();
        let n_centers = per_axis.iter().fold(1, |product: u64, &n| product.saturating_mul(n as u64));
        let max_centers = free_bytes / BYTES_PER_CENTER;
        if n_centers > max_centers {
            let found = format!("{n_centers} centers");
            let needed =
                format!("at most {max_centers}: {:.1} GB of memory are free here", free_bytes as f64 * 1e-9);
            return Err(file.refusal(&format!("{table}.centers_per_axis"), &found, &needed));
        }
    }
    Ok(())
}

/// Memory that is still available; `None` if the system does not report it.
fn free_memory_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

fn initial_state(file: &ConfigFile) -> Result<InitialState, ConfigError> {
    let initial = &file.config.initial;
    let limits = &file.config.input;
    let vector = |key: &str, value: Option<[f64; 3]>, limit: f64| match value.map(Vector3::from) {
        // NaN is within no limit.
        Some(v) if v.norm() > limit || !v.norm().is_finite() => {
            let needed = format!("finite numbers of norm {limit} at most, the limit in [input]");
            Err(file.refusal(&format!("initial.{key}"), &format!("{:?}", v.as_slice()), &needed))
        }
        value => Ok(value),
    };
    let attitude = match initial.attitude_wxyz {
        None => None,
        Some([w, x, y, z]) => {
            let q = Quaternion::new(w, x, y, z);
            if !(0.999..=1.001).contains(&q.norm()) {
                let found = format!("norm {}", q.norm());
                return Err(file.refusal("initial.attitude_wxyz", &found, "a unit quaternion w, x, y, z"));
            }
            Some(UnitQuaternion::from_quaternion(q))
        }
    };
    Ok(InitialState {
        position_m: vector("position_m", initial.position_m, limits.max_position_m)?,
        velocity_m_s: vector("velocity_m_s", initial.velocity_m_s, limits.max_speed_m_s)?,
        attitude,
        angular_velocity_rad_s: vector(
            "angular_velocity_rad_s",
            initial.angular_velocity_rad_s,
            limits.max_angular_rate_rad_s,
        )?,
    })
}

fn translation(keys: &TranslationConfig, rate_hz: f64) -> Result<TranslationDesign, DesignError> {
    let known_force_n = known_force_n(keys)?;
    let inertia = Matrix3::identity() * keys.mass_kg;
    Ok(TranslationDesign {
        channel: channel(
            &keys.common(),
            inertia,
            given(keys.gain_per_s, Parameter::Gain)?,
            &given(keys.adaptation_rate_kg_s2, Parameter::AdaptationRate)?,
            rate_hz,
        )?,
        known_force_n,
        velocity_error_to_position: keys.velocity_error_to_position,
        position_fix_gain_per_s: keys.position_fix_gain_per_s,
        position_fix_hold_s: keys.position_fix_hold_s,
    })
}

fn rotation(keys: &RotationConfig, rate_hz: f64) -> Result<RotationDesign, DesignError> {
    let inertia = matrix3(&keys.inertia_kg_m2);
    Ok(RotationDesign {
        channel: channel(
            &keys.common(),
            inertia,
            given(keys.gain_per_s, Parameter::Gain)?,
            &given(keys.adaptation_rate_n_m, Parameter::AdaptationRate)?,
            rate_hz,
        )?,
        gyroscopic_torque: gyroscopic_torque(keys),
        attitude_fix_gain_per_s: keys.attitude_fix_gain_per_s,
        attitude_fix_hold_s: keys.attitude_fix_hold_s,
    })
}

fn gyroscopic_torque(keys: &RotationConfig) -> GyroscopicTorque {
    match keys.gyroscopic_torque {
        GyroscopicTorqueName::Learned => GyroscopicTorque::Learned,
        GyroscopicTorqueName::Feedforward => GyroscopicTorque::Feedforward,
    }
}

/// Gravity and the other known force (N).
fn known_force_n(keys: &TranslationConfig) -> Result<Vector3<f64>, DesignError> {
    let force = keys.mass_kg * Vector3::from(keys.gravity_m_s2) + Vector3::from(keys.known_force_n);
    if force.iter().any(|f| !f.is_finite()) {
        let found = format!("{:?} N with gravity", force.as_slice());
        return Err(DesignError { parameter: Parameter::Inertia, found, needed: "finite numbers".into() });
    }
    Ok(force)
}

/// The law of a table whose tables `joint` differ in their units.
macro_rules! joint_design {
    ($keys:expr, $joint:expr, $half_widths:expr, $prior:expr, $noise:expr, $process_noise:expr) => {{
        let common = $keys.common();
        let half_widths: [f64; 3] = $half_widths;
        let per_axis = common.centers_per_axis.unwrap_or(&[3; 3]);
        JointDesign {
            kernel: kernel(common.kernel, 3),
            length_scale: common
                .length_scale
                .map_or_else(|| LengthScale::PerAxis(half_widths.to_vec()), length_scale),
            centers: box_centers(half_widths, per_axis)?,
            prior: $prior,
            disturbance_time_s: $joint.disturbance_time_s,
            process_noise: $process_noise,
            motion_memory_s: $joint.motion_memory_s,
            input_memory_s: $joint.input_memory_s,
            lags_s: $joint.lag_times_s,
            noise: $noise.into(),
            position_noise: None,
            body_axes: None,
            accelerometer: None,
            noise_samples: $joint.noise_memory_samples,
            excitation: ExcitationDesign {
                correction_share: $joint.correction_share,
                mean_time_s: $joint.excitation_mean_time_s,
                variation_time_s: $joint.excitation_variation_time_s,
                idle_rate: $joint.excitation_idle_rate,
            },
        }
    }};
}

fn box_centers(half_widths: [f64; 3], per_axis: &[usize]) -> Result<Centers, DesignError> {
    if !half_widths.iter().all(|width| (1e-6..=1e6).contains(width)) {
        let found = format!("{half_widths:?}");
        let needed = "numbers from 1e-6 to 1e6".to_owned();
        return Err(DesignError { parameter: Parameter::Joint("box"), found, needed });
    }
    Centers::lattice(half_widths.map(|width| -width), half_widths, per_axis)
}

fn joint_translation(keys: &TranslationConfig, rate_hz: f64) -> Result<JointTranslationDesign, DesignError> {
    let joint = &keys.joint;
    let box_m_s: [f64; 3] = given(keys.speed_box_m_s, Parameter::Joint("box"))?.into();
    let prior = PriorDeviations {
        bias: joint.prior_bias_m_s2,
        linear: joint.prior_linear_m_s2,
        kernel: joint.prior_kernel_m_s2,
        input: joint.prior_input,
        lag: joint.prior_lag,
        disturbance: joint.disturbance_std_m_s2,
    };
    let noise = given(keys.velocity_noise_m_s, Parameter::Joint("noise"))?;
    let mut filter = joint_design!(keys, joint, box_m_s, prior, noise, joint.process_noise_m2_s3);
    filter.position_noise = Some(keys.position_noise_m);
    // Said by the service even where they are not used.
    for (name, value) in [
        ("turn", joint.prior_turn),
        ("accelerometer_noise", joint.specific_force_noise_m_s2),
        ("accelerometer_bias", joint.specific_force_bias_m_s2),
        ("accelerometer_bias_time_s", joint.specific_force_bias_time_s),
    ] {
        if !(value.is_finite() && value >= 0.0) {
            let needed = "a finite number ≥ 0".to_owned();
            return Err(DesignError { parameter: Parameter::Joint(name), found: value.to_string(), needed });
        }
    }
    let body_axes = BodyAxesDesign { turn: joint.prior_turn };
    filter.body_axes = (keys.force_axes == ForceAxesName::Body).then_some(body_axes);
    filter.accelerometer = (joint.specific_force_noise_m_s2 > 0.0).then_some(AccelerometerDesign {
        noise: joint.specific_force_noise_m_s2,
        bias: joint.specific_force_bias_m_s2,
        bias_time_s: joint.specific_force_bias_time_s,
    });
    let channel =
        joint_channel(filter, Matrix3::identity() * keys.mass_kg, keys.sample_rate_hz.unwrap_or(rate_hz));
    Ok(JointTranslationDesign {
        channel,
        known_force_n: known_force_n(keys)?,
        gravity_m_s2: keys.gravity_m_s2.into(),
    })
}

fn joint_rotation(keys: &RotationConfig, rate_hz: f64) -> Result<JointRotationDesign, DesignError> {
    let joint = &keys.joint;
    let box_rad_s: [f64; 3] = given(keys.rate_box_rad_s, Parameter::Joint("box"))?.into();
    let prior = PriorDeviations {
        bias: joint.prior_bias_rad_s2,
        linear: joint.prior_linear_rad_s2,
        kernel: joint.prior_kernel_rad_s2,
        input: joint.prior_input,
        lag: joint.prior_lag,
        disturbance: joint.disturbance_std_rad_s2,
    };
    let noise = given(keys.angular_velocity_noise_rad_s, Parameter::Joint("noise"))?;
    let filter = joint_design!(keys, joint, box_rad_s, prior, noise, joint.process_noise_rad2_s3);
    Ok(JointRotationDesign {
        channel: joint_channel(filter, matrix3(&keys.inertia_kg_m2), keys.sample_rate_hz.unwrap_or(rate_hz)),
        gyroscopic_torque: gyroscopic_torque(keys),
        attitude_noise_rad: keys.attitude_noise_rad,
        bias_std_rad_s: joint.gyro_bias_std_rad_s,
        bias_walk_rad_s_sqrt_s: joint.gyro_bias_walk_rad_s_sqrt_s,
    })
}

fn joint_channel(filter: JointDesign, inertia: Matrix3<f64>, sample_rate_hz: f64) -> JointChannelDesign {
    JointChannelDesign { filter, inertia, hold_s: HOLD_PERIODS / sample_rate_hz }
}

/// A channel of the rigid body with the gradient law; its output has three axes.
fn channel(
    keys: &CommonKeys<'_>,
    inertia: Matrix3<f64>,
    gain_per_s: f64,
    adaptation_rate: &SymmetricMatrix,
    rate_hz: f64,
) -> Result<ChannelDesign, DesignError> {
    Ok(ChannelDesign {
        kernel: kernel(keys.kernel, 3),
        length_scale: length_scale(given(keys.length_scale, Parameter::LengthScale)?),
        centers: centers(keys)?,
        nugget: keys.nugget,
        solver: solver(keys.solver),
        inertia,
        gain_per_s,
        adaptation_rate: matrix3(adaptation_rate),
        dead_zone: dead_zone(keys)?,
        options: options(keys),
        bounds: bounds(keys)?,
        hold_s: HOLD_PERIODS / keys.sample_rate_hz.unwrap_or(rate_hz),
        coast_step_s: rate_hz.recip(),
    })
}

fn linear(config: &LinearConfig, rate_hz: f64) -> Result<LinearDesign, DesignError> {
    let keys = config.common();
    let n_outputs = config.c.len();
    if let Some(names) = config.state_names.as_ref().filter(|names| names.len() != config.a.len()) {
        return Err(DesignError {
            parameter: Parameter::Plant,
            found: format!("{} state_names for {} states", names.len(), config.a.len()),
            needed: "one name per row of a".into(),
        });
    }
    Ok(LinearDesign {
        a: matrix(Parameter::Plant, "a", &config.a)?,
        b: matrix(Parameter::PlantInput, "b", &config.b)?,
        c: matrix(Parameter::PlantOutput, "c", &config.c)?,
        gain: matrix(Parameter::Gain, "gain", &config.gain)?,
        kernel: kernel(keys.kernel, n_outputs),
        length_scale: length_scale(given(keys.length_scale, Parameter::LengthScale)?),
        centers: centers(&keys)?,
        nugget: keys.nugget,
        solver: solver(keys.solver),
        adaptation_rate: match given(config.adaptation_rate.as_ref(), Parameter::AdaptationRate)? {
            SquareMatrix::Scalar(rate) => DMatrix::identity(n_outputs, n_outputs) * *rate,
            SquareMatrix::Diagonal(rates) => DMatrix::from_diagonal(&DVector::from_column_slice(rates)),
            SquareMatrix::Full(rows) => matrix(Parameter::AdaptationRate, "adaptation_rate", rows)?,
        },
        dead_zone: dead_zone(&keys)?,
        options: options(&keys),
        bounds: bounds(&keys)?,
        hold_s: HOLD_PERIODS / keys.sample_rate_hz.unwrap_or(rate_hz),
        coast_step_s: rate_hz.recip(),
        initial_state: config.initial_state.clone().map(DVector::from_vec),
    })
}

/// A lattice or a list, whichever is given.
fn centers(keys: &CommonKeys<'_>) -> Result<Centers, DesignError> {
    match (keys.centers_lower, keys.centers_upper, keys.centers_per_axis, &keys.centers_listed) {
        (Some(lower), Some(upper), Some(per_axis), None) => Centers::lattice(lower, upper, per_axis),
        (None, None, None, Some(listed)) => Centers::listed(listed),
        (lower, upper, per_axis, listed) => {
            let given = [lower.is_some(), upper.is_some(), per_axis.is_some(), listed.is_some()];
            let words = ["a lower corner", "an upper corner", "a number per axis", "a list"];
            let found: Vec<_> =
                words.iter().zip(given).filter(|(_, given)| *given).map(|(word, _)| *word).collect();
            Err(DesignError {
                parameter: Parameter::Centers,
                found: if found.is_empty() { "none".into() } else { found.join(" and ") },
                needed: "either centers_lower_…, centers_upper_… and centers_per_axis, or centers_listed_…"
                    .into(),
            })
        }
    }
}

fn kernel(name: KernelName, dimension: usize) -> Kernel {
    match name {
        KernelName::SobolevMatern(order) => Kernel::SobolevMatern { dimension, order },
        KernelName::Gaussian => Kernel::Gaussian,
        KernelName::WendlandC2 => Kernel::WendlandC2,
        KernelName::WendlandC4 => Kernel::WendlandC4,
    }
}

fn length_scale(config: &LengthScaleConfig) -> LengthScale {
    match config {
        LengthScaleConfig::Isotropic(scale) => LengthScale::Isotropic(*scale),
        LengthScaleConfig::PerAxis(scales) => LengthScale::PerAxis(scales.clone()),
    }
}

fn solver(config: SolverConfig) -> Solver {
    let (name, options) = match config {
        SolverConfig::Name(name) => (name, LocalSolver::default()),
        SolverConfig::Options(SolverOptions { kind, block, accuracy, truncation }) => {
            (kind, LocalSolver { block, accuracy, truncation })
        }
    };
    match name {
        SolverName::Auto => Solver::Auto(options),
        SolverName::Dense => Solver::Dense,
        SolverName::Local => Solver::Local(options),
    }
}

fn dead_zone(keys: &CommonKeys<'_>) -> Result<DeadZone, DesignError> {
    let shape = match keys.dead_zone {
        DeadZoneName::Saturated => DeadZoneShape::Saturated,
        DeadZoneName::Quadratic => DeadZoneShape::Quadratic,
        DeadZoneName::Step => DeadZoneShape::Step,
    };
    let width = given(keys.dead_zone_width, Parameter::DeadZoneWidth)?;
    DeadZone::new(shape, width, given(keys.dead_zone_buffer, Parameter::DeadZoneBuffer)?)
}

fn options(keys: &CommonKeys<'_>) -> GradientOptions {
    GradientOptions {
        feature_point: match keys.features_at {
            FeaturesAtName::Measured => FeaturePoint::Measured,
            FeaturesAtName::Estimated => FeaturePoint::Estimated,
        },
        max_norm: keys.max_native_norm,
    }
}

fn bounds(keys: &CommonKeys<'_>) -> Result<DisturbanceBounds, DesignError> {
    Ok(DisturbanceBounds {
        noise: given(keys.noise_bound, Parameter::NoiseBound)?,
        unmatched: keys.unmatched_bound,
        residual_norm: keys.residual_norm_bound,
    })
}

/// A value that the law needs; [`ConfigFile::check`] has looked, but a configuration may be changed after it was read.
fn given<T>(value: Option<T>, parameter: Parameter) -> Result<T, DesignError> {
    value.ok_or_else(|| DesignError { parameter, found: "none".into(), needed: "a value".into() })
}

fn matrix3(config: &SymmetricMatrix) -> Matrix3<f64> {
    match config {
        SymmetricMatrix::Scalar(a) => Matrix3::identity() * *a,
        SymmetricMatrix::Diagonal(diagonal) => Matrix3::from_diagonal(&Vector3::from(*diagonal)),
        SymmetricMatrix::Full(rows) => Matrix3::from_fn(|i, j| rows[i][j]),
    }
}

fn matrix(parameter: Parameter, key: &str, rows: &[Vec<f64>]) -> Result<DMatrix<f64>, DesignError> {
    let n_columns = rows.first().map_or(0, Vec::len);
    if n_columns > 0 && rows.iter().all(|row| row.len() == n_columns) {
        return Ok(DMatrix::from_row_iterator(rows.len(), n_columns, rows.iter().flatten().copied()));
    }
    Err(DesignError {
        parameter,
        found: format!("{key} with rows of {:?} numbers", rows.iter().map(Vec::len).collect::<Vec<_>>()),
        needed: "rows of the same length, [[…], […]]".into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_that_does_not_fit_into_memory_is_refused_by_its_key() {
        let file = ConfigFile::preset("million-centers").unwrap();
        assert!(free_memory_bytes().unwrap() > 1_000_000);
        assert_eq!(check_memory(&file, Some(80_000_000)), Ok(()));
        assert_eq!(check_memory(&file, None), Ok(()));
        let message = check_memory(&file, Some(79_999_999)).unwrap_err().to_string();
        let expected = "translation.centers_per_axis: found 1000000 centers; needed: at most 999999: 0.1 GB of memory are free here";
        assert!(message.contains(expected), "{message}");
    }

    #[test]
    fn the_solver_s_default_options_are_those_of_its_name() {
        let solvers = ["solver = \"local\"", "[linear.solver]\nkind = \"local\""].map(|solver| {
            let text = format!("{}\n{solver}\n", include_str!("../presets/linear.toml"));
            linear_design(&ConfigFile::parse("vehicle.toml".into(), text).unwrap()).unwrap().unwrap().solver
        });
        assert_eq!(solvers[0], solvers[1]);
    }
}
