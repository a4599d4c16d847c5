//! `sim_publisher replay`: publishes a recorded flight with its own timing.

use super::arguments::ImportArguments;
use super::target::{Failure, TargetArgs, publish_source, report};
use crate::delivery::Outgoing;
use crate::publish::Pace;
use clap::Args;
use importers::{Importer, RecordedFlight, read_flight};
use shared_types::logln;

#[derive(Debug, Args)]
pub(super) struct ReplayArgs {
    #[command(flatten)]
    flight: ImportArguments,
    /// How many times faster than it was flown; stamps keep the flight's own time
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    speed: f64,
    /// Only the part in the air (acsl, ulog)
    #[arg(long)]
    airborne_only: bool,
    #[command(flatten)]
    target: TargetArgs,
}

/// The part in the air, as a flight of its own.
fn airborne_part(
    flight: &RecordedFlight,
    importer: &dyn Importer,
    file: &str,
) -> Result<RecordedFlight, Failure> {
    let refused = |found: String| Failure::Usage(format!("--airborne-only: {found}; leave the option out"));
    let how = importer.format().airborne_by.ok_or_else(|| {
        refused(format!(
            "'{file}': format '{}' does not tell when it was in the air (acsl and ulog do)",
            importer.format().name
        ))
    })?;
    flight.airborne_only().ok_or_else(|| refused(format!("'{file}': no flight found by {how}")))
}

pub(super) fn replay(args: &ReplayArgs) -> Result<(), Failure> {
    if !(args.speed > 0.0 && args.speed <= 1000.0) {
        return Err(Failure::Usage(format!("--speed {}: needed: above 0, at most 1000", args.speed)));
    }
    let (importer, options) = (args.flight.importer()?, args.flight.options()?);
    let mut flight = read_flight(importer, &args.flight.file, &options)?;
    let file = args.flight.file.display().to_string();
    flight.findings().iter().for_each(|finding| logln!("'{file}': {finding}"));
    if args.airborne_only {
        flight = airborne_part(&flight, importer, &file)?;
    }
    if args.speed != 1.0 {
        logln!(
            "stamps keep the flight's own time while it passes {} times as fast: \
             the service must run with clock = \"samples\" in its configuration",
            args.speed
        );
    }
    let what = format!(
        "'{file}': {} samples, {:.1} s, at {} times its speed",
        flight.samples.len(),
        flight.duration_s(),
        args.speed
    );
    let skipped_rows = flight.skipped_rows();
    let source = flight.samples.into_iter().map(Outgoing::from);
    let pace = Pace { speed: args.speed, ..Pace::live() };
    let published = publish_source(&args.target, &what, source, pace, |_| ())?;
    let details =
        [("file", file.into()), ("speed", args.speed.into()), ("rows_skipped", skipped_rows.into())];
    report(&args.target, &published, details);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Measurement;

    /// A flight of one sample, in the air or not.
    fn flight(airborne: Option<std::ops::Range<usize>>) -> RecordedFlight {
        let (skipped, samples) = (importers::Skipped::default(), vec![Measurement::default()]);
        RecordedFlight { samples, skipped, values_not_finite: 0, airborne, remarks: Vec::new() }
    }

    #[test]
    fn a_format_that_does_not_tell_is_told_from_a_log_in_which_nothing_flew() {
        let part = |format: &str, airborne| {
            airborne_part(&flight(airborne), importers::by_name(format).unwrap(), "a.log")
        };
        let refused = |format: &str| match part(format, None) {
            Err(Failure::Usage(sentence)) => sentence,
            other => panic!("{other:?}"),
        };
        let [csv, acsl, ulog] = ["csv", "acsl", "ulog"].map(refused);
        assert!(csv.contains("format 'csv' does not tell"), "{csv}");
        assert!(acsl.contains("no flight found by thrust above 5 N"), "{acsl}");
        assert!(ulog.contains("no flight found by its land detection"), "{ulog}");
        assert_eq!(part("acsl", Some(0..1)).unwrap().samples.len(), 1);
    }
}
