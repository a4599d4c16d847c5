//! The channel that is measured, with its solver and number of centers.

use super::channel;
use nalgebra::Vector3;
use observer::{BodyChannel, JointChannel, JointSample, JointTranslationDesign, SolverInUse, Teaches};
use std::fmt::{self, Display, Formatter};
use std::time::Instant;

/// How f̂ is evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Solver {
    /// With the factor of all centers: exact.
    Dense,
    /// From a block with this many lattice points along each axis.
    Local(usize),
    /// The joint law: one Kalman filter, with all centers.
    Joint,
}

impl Solver {
    pub(super) const ALL: [Self; 4] = [Self::Dense, Self::Joint, Self::Local(4), Self::Local(6)];

    /// As the configuration calls it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Dense => "dense",
            Self::Local(_) => "local",
            Self::Joint => "joint",
        }
    }
}

impl Display for Solver {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dense => f.write_str("dense"),
            Self::Joint => f.write_str("joint"),
            Self::Local(block) => write!(f, "local {block}³"),
        }
    }
}

/// The channel that takes the steps.
pub(super) enum Stepped {
    Gradient(Box<BodyChannel>),
    /// With the stamp of its newest sample (ns).
    Joint(Box<JointChannel<()>>, u64),
}

impl Stepped {
    /// A whole step: the output is used, and the state predicted to the next one.
    pub(super) fn step(&mut self, output: &Vector3<f64>, input_n: &Vector3<f64>) {
        match self {
            Self::Gradient(channel) => _ = channel.step(output, input_n, channel::STEP_S),
            Self::Joint(channel, stamp_ns) => {
                *stamp_ns += (1e9 * channel::STEP_S) as u64;
                let sample = JointSample {
                    output: std::array::from_fn(|axis| Some(output[axis])),
                    command: Some(*input_n),
                    ..JointSample::default()
                };
                channel.accept(*stamp_ns, &sample, Teaches::All, None::<fn(&mut ())>);
            }
        }
    }

    /// Whether the newest step taught.
    pub(super) fn has_learned(&self) -> bool {
        match self {
            Self::Gradient(channel) => channel.law().held().output_error.norm() > channel::DEAD_ZONE_WIDTH,
            Self::Joint(channel, _) => channel.state().teaching() > 0.5,
        }
    }

    /// The channel of the gradient law, if it is one.
    pub(super) fn gradient_mut(&mut self) -> Option<&mut BodyChannel> {
        match self {
            Self::Gradient(channel) => Some(channel),
            Self::Joint(..) => None,
        }
    }
}

/// A channel to be measured, and the description for its row.
pub(super) struct Subject {
    pub(super) solver: Solver,
    pub(super) n_centers: usize,
    /// How they are laid out.
    pub(super) centers: String,
    /// What a step reads.
    pub(super) bytes: usize,
    /// From the design to the channel.
    pub(super) set_up_s: f64,
    /// RMS of the solver's error over that of f̂, for random updates; `None` where it is exact.
    pub(super) predicted_error: Option<f64>,
    pub(super) channel: Stepped,
}

impl Subject {
    pub(super) fn build(solver: Solver, n_centers: usize) -> anyhow::Result<Self> {
        match solver {
            Solver::Dense => Self::dense(n_centers),
            Solver::Local(block) => Self::local(n_centers, block),
            Solver::Joint => Self::joint(n_centers),
        }
    }

    fn joint(n_centers: usize) -> anyhow::Result<Self> {
        let (centers, layout) = channel::centers(n_centers)?;
        let design = JointTranslationDesign {
            channel: channel::joint_design(centers),
            known_force_n: Vector3::zeros(),
            gravity_m_s2: Vector3::zeros(),
        };
        let started = Instant::now();
        let channel = JointChannel::translation(&design, None, None)?;
        Ok(Self {
            solver: Solver::Joint,
            n_centers,
            centers: layout,
            bytes: channel.filter().bytes_of_step(),
            set_up_s: started.elapsed().as_secs_f64(),
            predicted_error: None,
            channel: Stepped::Joint(Box::new(channel), 0),
        })
    }

    fn local(n_centers: usize, block: usize) -> anyhow::Result<Self> {
        let edge = (n_centers as f64).cbrt().round() as usize;
        let design = channel::local_design(edge, block)?;
        let started = Instant::now();
        let channel = BodyChannel::new(&design)?;
        let set_up_s = started.elapsed().as_secs_f64();
        let SolverInUse::Local { predicted_error, .. } = channel.law().function().solver() else {
            anyhow::bail!("a lattice of {edge}³ centers is not solved locally");
        };
        Ok(Self {
            solver: Solver::Local(block),
            n_centers,
            centers: format!("lattice {edge}³"),
            bytes: channel.law().function().bytes_of_step(),
            set_up_s,
            predicted_error: Some(predicted_error),
            channel: Stepped::Gradient(Box::new(channel)),
        })
    }

    pub(super) fn dense(n_centers: usize) -> anyhow::Result<Self> {
        let (lattice, centers) = channel::centers(n_centers)?;
        let design = channel::design(lattice)?;
        let started = Instant::now();
        let channel = BodyChannel::new(&design)?;
        let set_up_s = started.elapsed().as_secs_f64();
        let bytes = channel.law().function().bytes_of_step();
        let (solver, predicted_error) = (Solver::Dense, None);
        let channel = Stepped::Gradient(Box::new(channel));
        Ok(Self { solver, n_centers, centers, bytes, set_up_s, predicted_error, channel })
    }
}
