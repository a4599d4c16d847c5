//! `bench accuracy`: every flight, one configuration, several estimators side by side; a table, a JSON document, a page.
//!
//! | file | what lives there |
//! |---|---|
//! | `cases` | the flights: recorded ones, and simulated ones whose truth is known |
//! | `estimators` | what is compared, each as it takes samples and predicts |
//! | `judge` | the errors of one estimator on one flight |
//! | `report` | the table and the JSON document |
//! | `page` | the page with the figures |

mod cases;
mod estimators;
mod judge;
mod page;
mod report;

use crate::disturbance_filter::DisturbanceFilter;
use crate::harness::output::{progress_bar, show};
use crate::kalman::densities_n2_s;
use anyhow::{Context, ensure};
use cases::Case;
use clap::Args;
use daemon::assemble;
use daemon::config::ConfigFile;
use estimators::{LeastSquares, Observer};
use judge::{HORIZONS_S, Judgement, judge};
use observer::{ChannelName, Learn, RigidBodyObserver};
use report::{Estimators, Report};
use shared_types::logln;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How long the Gauss–Markov force lasts (s).
const GAUSS_MARKOV_TIME_S: f64 = 2.0;
/// A panic in a thread ends the program.
const UNPOISONED: &str = "no estimator panicked";

/// Arguments of `bench accuracy`.
#[derive(Debug, Args)]
pub(crate) struct AccuracyArguments {
    /// Logs, or directories of logs.
    #[arg(value_name = "DIR|FILE", required_unless_present = "simulated")]
    paths: Vec<PathBuf>,
    /// Simulated flights, too: a multicopter, an underwater vehicle, the paper's translation.
    #[arg(long)]
    simulated: bool,
    /// Configuration file for all [default: that of each format: preset acsl-x8 for acsl logs, the
    /// NanoBench vehicle for its tables, preset rigid-body otherwise].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Take position fixes in place of the velocities, which are only compared with.
    #[arg(long)]
    positions: bool,
    /// Use the flights' specific forces, in coasts, too: the joint law with the default accelerometer.
    #[arg(long)]
    accelerometer: bool,
    /// Start from what this flight teaches: another flight of the same vehicle.
    #[arg(long, value_name = "FILE")]
    warm: Option<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Write a page with the figures to FILE.html.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

/// What one thread does: an estimator on a case.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Joint,
    Gradient,
    WithoutLearning,
    /// With the density of this index.
    Kalman(usize),
    GaussMarkov(usize),
    LeastSquares,
}

impl Kind {
    fn all() -> Vec<Self> {
        let n_densities = densities_n2_s(1.0).len();
        let alone = [Self::Joint, Self::Gradient, Self::WithoutLearning, Self::LeastSquares];
        let swept = (0..n_densities).flat_map(|index| [Self::Kalman(index), Self::GaussMarkov(index)]);
        alone.into_iter().chain(swept).collect()
    }

    /// Empty where the estimator cannot take what the case measures.
    fn judge(self, case: &Case, warm: &Warm) -> anyhow::Result<Judgement> {
        if case.by_positions && matches!(self, Self::Gradient | Self::LeastSquares) {
            return Ok(Judgement::default());
        }
        let translation = case.translation();
        let density = |index: usize| densities_n2_s(translation.mass_kg)[index];
        Ok(match self {
            Self::Joint => {
                let observer = warm.started(assemble::rigid_body(&case.config)?, &warm.joint)?;
                judge(case, Observer::new(observer, Learn::ALL))
            }
            Self::Gradient => {
                let observer = assemble::rigid_body(&case.with_the_gradient_law()?)?;
                judge(case, Observer::new(warm.started(observer, &warm.gradient)?, Learn::ALL))
            }
            Self::WithoutLearning => {
                judge(case, Observer::new(assemble::rigid_body(&case.config)?, Learn::FROZEN))
            }
            Self::Kalman(index) => judge(case, DisturbanceFilter::new(translation, density(index), None)?),
            Self::GaussMarkov(index) => {
                judge(case, DisturbanceFilter::new(translation, density(index), Some(GAUSS_MARKOV_TIME_S))?)
            }
            Self::LeastSquares => judge(case, LeastSquares::new(translation)),
        })
    }
}

/// What another flight taught: the learned numbers of the translation, of each law; empty for nothing.
#[derive(Debug, Default)]
struct Warm {
    joint: Vec<f64>,
    gradient: Vec<f64>,
}

impl Warm {
    fn of(case: &Case) -> anyhow::Result<Self> {
        let learned = |config: &ConfigFile| -> anyhow::Result<Vec<f64>> {
            let mut observer = assemble::rigid_body(config)?;
            case.samples.iter().for_each(|sample| _ = observer.accept(sample, Learn::ALL));
            let translation = observer.channel_mut(ChannelName::Translation).context("no translation")?;
            translation.save();
            let mut learned = vec![0.0; translation.n_learned()];
            translation.read_saved(0, &mut learned);
            Ok(learned)
        };
        let gradient = match case.by_positions {
            true => Vec::new(),
            false => learned(&case.with_the_gradient_law()?)?,
        };
        Ok(Self { joint: learned(&case.config)?, gradient })
    }

    fn started(&self, mut observer: RigidBodyObserver, learned: &[f64]) -> anyhow::Result<RigidBodyObserver> {
        if !learned.is_empty() {
            let translation = observer.channel_mut(ChannelName::Translation).context("no translation")?;
            ensure!(
                translation.n_learned() == learned.len(),
                "--warm: {} learned numbers; needed: {}, from a flight with the same law and centers",
                learned.len(),
                translation.n_learned()
            );
            translation.load(learned, None);
        }
        Ok(observer)
    }
}

/// Runs `bench accuracy`.
pub(crate) fn run(arguments: &AccuracyArguments) -> anyhow::Result<()> {
    if let Some(page) = &arguments.html {
        page::check_target(page)?;
    }
    let config = arguments.config.as_deref().map(ConfigFile::read).transpose()?;
    let mut cases = Vec::new();
    let mut refused = Vec::new();
    for file in cases::files_of(&arguments.paths)? {
        match cases::recorded(&file, config.as_ref(), arguments.positions) {
            Ok(mut case) if arguments.accelerometer => match case.use_accelerometer() {
                Ok(()) => cases.push(case),
                Err(error) => refused.push((file.display().to_string(), format!("{error:#}"))),
            },
            Ok(case) => cases.push(case),
            Err(error) => {
                logln!("bench: '{}' is not judged: {error:#}", file.display());
                refused.push((file.display().to_string(), format!("{error:#}")));
            }
        }
    }
    if arguments.simulated {
        ensure!(
            !(arguments.positions || arguments.accelerometer),
            "--positions and --accelerometer are for recorded flights; leave out --simulated"
        );
        cases.extend(cases::simulated()?);
    }
    ensure!(!cases.is_empty(), "no flight can be judged; needed: a log that sim_publisher inspect reads");
    let warm = match &arguments.warm {
        Some(file) => Warm::of(&cases::recorded(file, config.as_ref(), arguments.positions)?)?,
        None => Warm::default(),
    };
    let judged = judge_all(&cases, &warm)?;
    let report = Report::new(&cases, &judged, refused);
    if let Some(file) = &arguments.html {
        page::write(file, &cases, &judged, &report)?;
    }
    show(arguments.json, &report.json(), || report.print(arguments.html.as_deref()))
}

/// Every estimator on every case, on all cores.
fn judge_all(cases: &[Case], warm: &Warm) -> anyhow::Result<Vec<Estimators>> {
    let kinds = Kind::all();
    let n_jobs = cases.len() * kinds.len();
    let bar = progress_bar(n_jobs as u64, "{bar:40} {pos}/{len} estimators on flights, {eta} left");
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::with_capacity(n_jobs)));
    let work = || {
        loop {
            let job = next.fetch_add(1, Ordering::Relaxed);
            if job >= n_jobs {
                return;
            }
            let (case, kind) = (job / kinds.len(), kinds[job % kinds.len()]);
            let judgement = kind.judge(&cases[case], warm);
            done.lock().expect(UNPOISONED).push((case, kind, judgement));
            bar.inc(1);
        }
    };
    let n_threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| (0..n_threads).for_each(|_| _ = scope.spawn(work)));
    bar.finish_and_clear();

    let mut judged: Vec<Estimators> = cases.iter().map(|_| Estimators::default()).collect();
    let mut done = done.into_inner().expect(UNPOISONED);
    done.sort_by_key(|(case, kind, _)| (*case, kinds.iter().position(|known| known == kind)));
    for (case, kind, judgement) in done {
        let judgement = judgement.with_context(|| format!("'{}'", cases[case].name))?;
        let estimators = &mut judged[case];
        match kind {
            Kind::Joint => estimators.joint = judgement,
            Kind::Gradient => estimators.gradient = judgement,
            Kind::WithoutLearning => estimators.none = judgement,
            Kind::LeastSquares => estimators.least_squares = judgement,
            Kind::Kalman(_) => estimators.kalman.push(judgement),
            Kind::GaussMarkov(_) => estimators.gauss_markov.push(judgement),
        }
    }
    Ok(judged)
}
