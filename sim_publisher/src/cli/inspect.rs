//! `sim_publisher inspect`: prints what a log holds.

use super::arguments::ImportArguments;
use super::target::Failure;
use clap::Args;
use shared_types::outln;

#[derive(Debug, Args)]
pub(super) struct InspectArgs {
    #[command(flatten)]
    log: ImportArguments,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

pub(super) fn inspect(args: &InspectArgs) -> Result<(), Failure> {
    let findings = importers::inspect(args.log.importer()?, &args.log.file, &args.log.options()?)?;
    match args.json {
        true => outln!("{}", serde_json::to_string_pretty(&findings).expect("numbers and names")),
        false => outln!("{findings}"),
    }
    Ok(())
}
