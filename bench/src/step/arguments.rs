//! The options of `bench step`, and the sizes and contestants that follow from them.

use super::subject::Solver;
use crate::harness::options::parse_seconds;
use clap::builder::TypedValueParser;
use std::path::PathBuf;

/// Latency of one channel step by number of centers, beside the paper's formula written out and a Kalman filter.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct StepArguments {
    /// Numbers of centers; cubes are laid out as a lattice, others as a quasi-random set.
    #[arg(
        long,
        value_name = "N,N,…",
        value_delimiter = ',',
        default_value = "27,125,343,729,1000,2197,4096,8000",
        default_value_if("quick", "true", "27,125,343,1000,2197"),
        value_parser = parse_n_centers
    )]
    pub(super) centers: Vec<usize>,
    /// Points along each axis of the cubic lattices for the local solver, with blocks of 4³ and 6³.
    #[arg(
        long,
        value_name = "n,n,…",
        value_delimiter = ',',
        default_value = "8,16,32,64,100",
        default_value_if("quick", "true", "8,100"),
        value_parser = clap::value_parser!(u32).range(8..=200).map(|edge| edge as usize)
    )]
    pub(super) lattices: Vec<usize>,
    /// A first look within 20 s: fewer centers, and less time for each of them.
    #[arg(long)]
    pub(super) quick: bool,
    /// Steps to time for each number of centers.
    #[arg(long, value_name = "COUNT", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub(super) samples: u32,
    /// Stop a size after this long, with fewer samples.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value = "8",
        default_value_if("quick", "true", "1.2"),
        value_parser = parse_seconds
    )]
    pub(super) seconds_per_size: f64,
    /// Run the literal formula up to this N: its matrix takes 72 N² bytes, and every step reads all of it.
    #[arg(long, value_name = "N", default_value = "1000", default_value_if("quick", "true", "343"))]
    pub(super) literal_up_to: usize,
    /// Print one JSON document instead of the table.
    #[arg(long)]
    pub(super) json: bool,
    /// Draw the latencies to FILE.svg.
    #[arg(long, value_name = "FILE")]
    pub(super) plot: Option<PathBuf>,
}

/// The joint law has a covariance of all weights: more centers than this are for the gradient law.
const MAX_JOINT_CENTERS: usize = 1000;

/// 20 000 centers take 1.6 GB once factored, and three times that while they are.
const MAX_CENTERS: usize = 20_000;

fn parse_n_centers(text: &str) -> Result<usize, String> {
    match text.trim().parse() {
        Ok(n) if (1..=MAX_CENTERS).contains(&n) => Ok(n),
        _ => Err(format!("needed: a number of centers from 1 to {MAX_CENTERS}")),
    }
}

impl StepArguments {
    /// What is measured, in this order.
    pub(super) fn sweep(&self) -> Vec<(Solver, usize)> {
        let dense = self.centers.iter().map(|&n| (Solver::Dense, n));
        let joint = self.centers.iter().filter(|&&n| n <= MAX_JOINT_CENTERS).map(|&n| (Solver::Joint, n));
        let local =
            |&block: &usize| self.lattices.iter().map(move |&edge| (Solver::Local(block), edge.pow(3)));
        dense.chain(joint).chain([4, 6].iter().flat_map(local)).collect()
    }

    /// The literal formula with this many centers where it is to be run, or why not.
    pub(super) fn literal<T>(
        &self,
        n: usize,
        build: impl FnOnce() -> anyhow::Result<T>,
    ) -> anyhow::Result<Result<T, String>> {
        let max = self.literal_up_to;
        if n > max {
            let megabytes = 72e-6 * (n as f64).powi(2);
            return Ok(Err(format!(
                "not run beyond N = {max} (--literal-up-to): its matrix would take {megabytes:.0} MB"
            )));
        }
        build().map(Ok)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct CommandLine {
        #[command(flatten)]
        step: StepArguments,
    }

    fn arguments(words: &[&str]) -> Result<StepArguments, clap::Error> {
        CommandLine::try_parse_from(["step"].iter().chain(words)).map(|line| line.step)
    }

    #[test]
    fn a_list_of_centers_is_split_at_commas() {
        assert_eq!(arguments(&[]).unwrap().centers, [27, 125, 343, 729, 1000, 2197, 4096, 8000]);
        assert_eq!(arguments(&["--quick", "--centers", "8, 50,27"]).unwrap().centers, [8, 50, 27]);
        for bad in ["0", "8,,27", "8;27", "-1", "100000"] {
            assert!(arguments(&["--centers", bad]).is_err(), "{bad}");
        }
        assert!(arguments(&["--samples", "0"]).is_err());
        assert!(arguments(&["--seconds-per-size", "nan"]).is_err());
    }

    #[test]
    fn quick_is_fewer_centers_and_less_time_where_nothing_else_is_asked_for() {
        let (usual, quick) = (arguments(&[]).unwrap(), arguments(&["--quick"]).unwrap());
        assert_eq!((usual.seconds_per_size, usual.literal_up_to), (8.0, 1000));
        assert_eq!((quick.seconds_per_size, quick.literal_up_to), (1.2, 343));
        assert_eq!(quick.centers, [27, 125, 343, 1000, 2197]);
        assert_eq!(arguments(&["--quick", "--literal-up-to", "8"]).unwrap().literal_up_to, 8);
    }
}
