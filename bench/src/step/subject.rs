//! The channel that is measured, with its solver and number of centers.

use super::channel;
use observer::{BodyChannel, SolverInUse};
use std::fmt::{self, Display, Formatter};
use std::time::Instant;

/// How f̂ is evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Solver {
    /// With the factor of all centers: exact.
    Dense,
    /// From a block with this many lattice points along each axis.
    Local(usize),
}

impl Solver {
    pub(super) const ALL: [Self; 3] = [Self::Dense, Self::Local(4), Self::Local(6)];

    /// As the configuration calls it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Dense => "dense",
            Self::Local(_) => "local",
        }
    }
}

impl Display for Solver {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dense => f.write_str("dense"),
            Self::Local(block) => write!(f, "local {block}³"),
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
    pub(super) channel: BodyChannel,
}

impl Subject {
    pub(super) fn build(solver: Solver, n_centers: usize) -> anyhow::Result<Self> {
        match solver {
            Solver::Dense => Self::dense(n_centers),
            Solver::Local(block) => Self::local(n_centers, block),
        }
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
            channel,
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
        Ok(Self { solver, n_centers, centers, bytes, set_up_s, predicted_error, channel })
    }
}
