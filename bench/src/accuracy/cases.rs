//! The flights that are judged: recorded ones, and simulated ones whose truth is known.

use anyhow::{Context, ensure};
use daemon::config::{ConfigFile, LawName, TranslationConfig};
use daemon::gate::sample_of;
use importers::{ImportOptions, Importer, Nanobench, RecordedFlight, is_nanobench, read_flight};
use nalgebra::{UnitQuaternion, Vector3};
use observer::{Sample, Velocity};
use shared_types::Measurement;
use shared_types::payload::valid;
use sim_publisher::{Scenario, Simulation, SimulationOptions};
use std::path::{Path, PathBuf};

/// A gap is longer than this many periods.
const GAP_PERIODS: f64 = 3.0;
/// Higher than this above the lowest point, a vehicle is clear of the ground (m).
const CLEAR_OF_GROUND_M: f64 = 0.1;
/// A flight in the air of at least this (s) can be judged.
const MIN_DURATION_S: f64 = 4.0;
const SIMULATED_S: f64 = 120.0;

/// The NanoBench vehicle; axes with z up.
const NANOBENCH: &str = "
rate_hz = 100.0
[translation]
mass_kg = 0.035
gravity_m_s2 = [0.0, 0.0, -9.81]
velocity_noise_m_s = 0.005
speed_box_m_s = [2.0, 2.0, 1.0]
";
/// And where the motion capture's fixes are taken in place of velocities.
const NANOBENCH_BY_POSITIONS: &str = "position_noise_m = 0.001\n";

/// A flight that is judged, and the configuration for it.
#[derive(Debug, Clone)]
pub(super) struct Case {
    pub(super) name: String,
    pub(super) config: ConfigFile,
    /// In the air; velocities along inertial axes.
    pub(super) samples: Vec<Sample>,
    /// Whether positions are measured in place of velocities.
    pub(super) by_positions: bool,
    /// What estimates of the samples' velocities are compared with.
    truths: Vec<Option<Vector3<f64>>>,
    /// What the importer says of the flight.
    pub(super) remarks: Vec<String>,
    gap_ns: u64,
}

/// White noise of an accelerometer on a vehicle that vibrates (m/s²).
const ACCELEROMETER_NOISE_M_S2: f64 = 0.5;

impl Case {
    /// Lets the joint law use the specific forces.
    ///
    /// # Errors
    /// There is none, or no `[translation]`.
    pub(super) fn use_accelerometer(&mut self) -> anyhow::Result<()> {
        let has_any = self.samples.iter().any(|sample| sample.specific_force_m_s2.is_some());
        ensure!(has_any, "no specific force; needed by --accelerometer");
        let translation = self.config.config.translation.as_mut().context("no [translation]")?;
        translation.joint.specific_force_noise_m_s2 = ACCELEROMETER_NOISE_M_S2;
        Ok(())
    }

    fn new(
        name: String,
        config: ConfigFile,
        samples: Vec<Sample>,
        truths: Vec<Option<Vector3<f64>>>,
    ) -> anyhow::Result<Self> {
        let with_truth = samples.iter().zip(&truths).filter(|(_, truth)| truth.is_some());
        let measured: Vec<u64> = with_truth.map(|(sample, _)| sample.stamp_ns).collect();
        let duration_s = match (measured.first(), measured.last()) {
            (Some(first), Some(last)) => (last - first) as f64 / 1e9,
            _ => 0.0,
        };
        ensure!(
            duration_s >= MIN_DURATION_S,
            "{duration_s:.1} s in the air with a velocity; needed: at least {MIN_DURATION_S} s"
        );
        ensure!(
            samples.iter().any(|sample| sample.force_n.is_some()),
            "no commanded force; needed: force columns, so that a coast knows what was commanded"
        );
        let mut periods: Vec<u64> = measured.windows(2).map(|pair| pair[1] - pair[0]).collect();
        periods.sort_unstable();
        let period_ns = periods[periods.len() / 2];
        let gap_ns = (GAP_PERIODS * period_ns as f64) as u64;
        let by_positions = samples.iter().all(|sample| sample.velocity.is_none());
        Ok(Self { name, config, samples, by_positions, truths, remarks: Vec::new(), gap_ns })
    }

    /// For tests: a flight with the preset of the X8.
    #[cfg(test)]
    pub(super) fn of(name: &str, samples: Vec<Sample>) -> Self {
        let truths = samples.iter().map(measured_velocity).collect();
        Self::new(name.into(), ConfigFile::preset("acsl-x8").unwrap(), samples, truths).unwrap()
    }

    /// Whether from one velocity to the next too long a time passed.
    pub(super) fn is_gap(&self, from_ns: u64, to_ns: u64) -> bool {
        to_ns.saturating_sub(from_ns) > self.gap_ns
    }

    /// What an estimate of a sample's velocity is compared with; `None` where it was not measured.
    pub(super) fn velocity(&self, index: usize) -> Option<Vector3<f64>> {
        self.truths[index]
    }

    pub(super) fn translation(&self) -> &TranslationConfig {
        self.config.config.translation.as_ref().expect("a case has a translation")
    }

    /// The same with the gradient law: gains in proportion to the mass, as chosen for the laboratory's X8 of 2.2 kg; the
    /// centers on the box.
    pub(super) fn with_the_gradient_law(&self) -> anyhow::Result<ConfigFile> {
        let translation = self.translation();
        if translation.law == LawName::Gradient {
            return Ok(self.config.clone());
        }
        let half: [f64; 3] = translation.speed_box_m_s.context("no speed_box_m_s")?.into();
        let noise: [f64; 3] = translation.velocity_noise_m_s.context("no velocity_noise_m_s")?.into();
        let widest = half.into_iter().fold(0.0, f64::max);
        let text = format!(
            "rate_hz = {}\n[translation]\nlaw = \"gradient\"\nmass_kg = {}\ngravity_m_s2 = {:?}\nknown_force_n = {:?}\n\
             sample_rate_hz = {}\ngain_per_s = 20.0\nadaptation_rate_kg_s2 = {}\nlength_scale_m_s = {widest}\n\
             centers_lower_m_s = {:?}\ncenters_upper_m_s = {half:?}\ncenters_per_axis = [3, 3, 3]\n\
             dead_zone_width_m_s = {}\ndead_zone_buffer_m_s = {}\nnoise_bound_m_s = {}\n",
            self.config.config.rate_hz,
            translation.mass_kg,
            translation.gravity_m_s2,
            translation.known_force_n,
            translation.sample_rate_hz.unwrap_or(self.config.config.rate_hz),
            100.0 / 2.2 * translation.mass_kg,
            half.map(|half| -half),
            noise[0],
            noise[0],
            3.0 * noise[0],
        );
        Ok(ConfigFile::parse("the gradient law".into(), text)?)
    }
}

/// Which files of a directory, or the files themselves.
pub(super) fn files_of(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            collect(path, &mut files)?;
        } else {
            files.push(path.clone());
        }
    }
    Ok(files)
}

fn collect(directory: &Path, files: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let cannot_read = || format!("cannot read the directory '{}'", directory.display());
    let mut entries: Vec<PathBuf> = std::fs::read_dir(directory)
        .with_context(cannot_read)?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<_, _>>()
        .with_context(cannot_read)?;
    entries.sort();
    for path in entries {
        if path.is_dir() {
            collect(&path, files)?;
        } else if importers::by_ending(&path).is_some() {
            files.push(path);
        }
    }
    Ok(())
}

/// A recorded flight, with this configuration or the one of its format.
pub(super) fn recorded(file: &Path, config: Option<&ConfigFile>, by_positions: bool) -> anyhow::Result<Case> {
    let by_ending = importers::by_ending(file)
        .context("the ending of no format; needed: one of those that sim_publisher inspect knows")?;
    let importer: &dyn Importer = match by_ending.format().name {
        "csv" if is_nanobench(&std::fs::read(file)?) => &Nanobench,
        _ => by_ending,
    };
    let format = importer.format().name;
    let flight = read_flight(importer, file, &ImportOptions::default())?;
    let config = match (config, format) {
        (Some(config), _) => config.clone(),
        (None, "acsl") => ConfigFile::preset("acsl-x8")?,
        (None, "nanobench") => {
            let fixes = if by_positions { NANOBENCH_BY_POSITIONS } else { "" };
            ConfigFile::parse("the NanoBench vehicle".into(), format!("{NANOBENCH}{fixes}"))?
        }
        (None, _) => ConfigFile::preset("rigid-body")?,
    };
    let remarks = flight.remarks.clone();
    let case = case_of(file.display().to_string(), config, in_the_air(flight), by_positions)?;
    Ok(Case { remarks, ..case })
}

/// The part in the air: as the format marks it, else clear of the lowest point with z down; all of it without a position.
fn in_the_air(flight: RecordedFlight) -> Vec<Measurement> {
    let flight = flight.airborne_only().unwrap_or(flight);
    let down_m = |m: &Measurement| m.has(valid::POSITION).then(|| m.position_m[2]);
    let Some(lowest_m) = flight.samples.iter().filter_map(down_m).reduce(f64::max) else {
        return flight.samples;
    };
    let is_clear = |m: &Measurement| down_m(m).is_some_and(|down_m| lowest_m - down_m > CLEAR_OF_GROUND_M);
    if flight.airborne.is_some() {
        return flight.samples;
    }
    match (flight.samples.iter().position(is_clear), flight.samples.iter().rposition(is_clear)) {
        (Some(first), Some(last)) => flight.samples[first..=last].to_vec(),
        _ => flight.samples,
    }
}

fn case_of(
    name: String,
    mut config: ConfigFile,
    measured: Vec<Measurement>,
    by_positions: bool,
) -> anyhow::Result<Case> {
    let limits = config.config.input;
    let samples = measured.iter().filter_map(|m| sample_of(m, &limits).ok());
    let mut samples: Vec<Sample> = samples.filter_map(with_inertial_velocity).collect();
    let truths = samples.iter().map(measured_velocity).collect();
    ensure!(config.config.translation.is_some(), "the configuration has no [translation]");
    if by_positions {
        let has_fix = |sample: &Sample| sample.position_m.is_some();
        ensure!(samples.iter().any(has_fix), "no position; needed by --positions");
        samples.iter_mut().for_each(|sample| sample.velocity = None);
    }
    // The velocity is inertial: the rotation has no part in it.
    config.config.rotation = None;
    Case::new(name, config, samples, truths)
}

fn measured_velocity(sample: &Sample) -> Option<Vector3<f64>> {
    match sample.velocity {
        Some(Velocity::Inertial(velocity)) => Some(velocity),
        _ => None,
    }
}

/// A body velocity turned by the attitude of the same sample; `None` without one.
fn with_inertial_velocity(sample: Sample) -> Option<Sample> {
    let turn = |attitude: UnitQuaternion<f64>, velocity| Velocity::Inertial(attitude * velocity);
    let velocity = match sample.velocity {
        Some(Velocity::Body(velocity)) => Some(turn(sample.attitude?, velocity)),
        other => other,
    };
    Some(Sample { velocity, ..sample })
}

/// The simulated cases, by name; the same in every run.
pub(super) fn simulated() -> anyhow::Result<Vec<Case>> {
    [
        ("simulated multicopter", Scenario::RigidBody, "rigid-body"),
        ("simulated AUV", Scenario::Auv, "auv"),
        ("the paper's translation", Scenario::Translation, "paper-translation-joint"),
    ]
    .into_iter()
    .map(|(name, scenario, preset)| {
        let mut config = ConfigFile::preset(preset)?;
        let limits = config.config.input;
        let options = SimulationOptions { duration_s: Some(SIMULATED_S), ..SimulationOptions::of(scenario) };
        let (mut samples, mut truths) = (Vec::new(), Vec::new());
        for simulated in Simulation::new(&options)? {
            let sample = simulated.measurement.and_then(|m| sample_of(&m, &limits).ok());
            if let Some(sample) = sample.and_then(with_inertial_velocity) {
                truths.push(sample.velocity.map(|_| Vector3::from(simulated.truth.velocity_m_s)));
                samples.push(sample);
            }
        }
        config.config.rotation = None;
        Case::new(name.into(), config, samples, truths)
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(j: u64) -> Measurement {
        let t = j as f64 * 0.01;
        let mut measured = Measurement::default()
            .with_velocity_m_s([t, 0.0, 0.0])
            .with_position_m([0.5 * t * t, 0.0, -1.0])
            .with_force_n([2.2, 0.0, -2.2 * 9.81]);
        (measured.sequence, measured.stamp_ns) = (j, j * 10_000_000);
        measured
    }

    #[test]
    fn by_positions_the_velocity_is_compared_with_and_not_taken() {
        let config = ConfigFile::preset("acsl-x8").unwrap();
        let case = case_of("a".into(), config.clone(), (0..600).map(measured).collect(), true).unwrap();
        assert!(case.by_positions && case.samples.iter().all(|sample| sample.velocity.is_none()));
        assert_eq!(case.velocity(100), Some(Vector3::new(1.0, 0.0, 0.0)));

        let without =
            (0..600).map(|j| Measurement { valid: measured(j).valid & !valid::POSITION, ..measured(j) });
        let refused = case_of("b".into(), config, without.collect(), true).unwrap_err().to_string();
        assert_eq!(refused, "no position; needed by --positions");
    }
}
