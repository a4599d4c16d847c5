//! The command line: a file for each subcommand.
//!
//! | file | holds |
//! |---|---|
//! | `run`, `replay`, `inspect`, `dvl`, `mavlink` | one subcommand each |
//! | `run_set` | `run --sensors` |
//! | `arguments` | arguments that several commands have, those of `bench` included |
//! | `target` | the target service, the end of a run, its errors |

mod arguments;
mod dvl;
mod inspect;
#[cfg(feature = "mavlink")]
mod mavlink;
mod replay;
mod run;
mod run_set;
mod target;

pub use arguments::ImportArguments;

use crate::faults::help as fault_help;
use clap::{Parser, Subcommand};
use shared_types::logln;
use std::ffi::OsString;
use std::process::ExitCode;

/// The vehicle's side of the estimation service: a simulated vehicle, a recorded flight, or a live one, as samples.
///
/// Results go to stdout, the log to stderr. Exit code 0: done (Ctrl-C included); 1: failed while running;
/// 2: wrong usage.
#[derive(Debug, Parser)]
#[command(
    name = "sim_publisher",
    after_help = "\
Examples:
  # A multicopter in wind, until Ctrl-C
  sim_publisher run --scenario rigid-body
  # A recorded flight
  sim_publisher replay --format acsl flight.log --airborne-only"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simulates a vehicle with its sensors and faults
    #[command(after_help = format!("{}\n\n\
Examples:
  # Samples that come late, get lost, and stay away
  sim_publisher run --scenario auv --dropout-probability 0.02 \\
      --jitter-us 300 --outage 10:0.5 --outage 20:1
  # A process for each sensor: a Doppler log 150 ms late, a USBL 1 s
  sim_publisher run --sensors auv-survey --processes --duration 60
  # As a table, at once
  sim_publisher run --scenario auv --duration 60 --table dive.csv
  # Spikes, then a killed vehicle's process; a summary for scripts
  sim_publisher run --scenario rigid-body --duration 20 --json \\
      --faults 'spike@5:2,size=3,every=10; kill@12:1'", fault_help()))]
    Run(run::RunArgs),
    /// Plays a recorded flight
    #[command(after_help = "\
Keys of --column and --map (SI; a quantity has all of its components or none). A
column that bears a key's own name needs no naming, body_velocity_x|y|z neither:
  time_s, or time with time_unit = s|ms|us|ns;  separator (default ,)
  velocity_x|y|z with velocity_frame = inertial|body;  angular_velocity_x|y|z
  position_x|y|z;  attitude_w|x|y|z;  force_x|y|z;  torque_x|y|z
  specific_force_x|y|z

Examples:
  sim_publisher replay --format acsl flight.log --airborne-only
  sim_publisher replay flight.ulg --mass-kg 1.5 --airborne-only
  # A recording of monitor record; another one (JSON or Protocol Buffers)
  sim_publisher replay flight.mcap
  sim_publisher replay bag.mcap --column velocity_x=/dvl:v.0 \\
      --column velocity_y=/dvl:v.1 --column velocity_z=/dvl:v.2
  # Four times as fast, with clock = \"samples\" in the service's configuration
  sim_publisher replay --format csv flight.csv --map map.toml --speed 4
  sim_publisher replay --format csv flight.csv --column time_s=t \\
      --column velocity_x=vx --column velocity_y=vy --column velocity_z=vz")]
    Replay(replay::ReplayArgs),
    /// Tells what a log holds, and which options and rates to use
    #[command(after_help = "\
Examples:
  sim_publisher inspect flight.ulg
  sim_publisher inspect flight.csv --column time_s=t --json")]
    Inspect(inspect::InspectArgs),
    /// Publishes the velocities of a Doppler log: Water Linked's JSON over TCP (A50, A125)
    #[command(after_help = "\
Velocity reports with bottom lock become samples, as old as their times of
validity and transmission say, and as sure as their covariance or figure of
merit. Dead reckoning is ignored.

Examples:
  # The log's own server; its place on the vehicle is [[sensor]] number 1
  sim_publisher dvl --connect tcp:192.168.2.95:16171 --sensor 1
  # Keep what comes, and play it again
  sim_publisher dvl --connect tcp:192.168.2.95 --record dive.jsonl
  sim_publisher dvl --replay dive.jsonl")]
    Dvl(dvl::DvlArgs),
    /// Bridges to a live vehicle: its MAVLink messages as samples, the estimate back
    #[cfg(feature = "mavlink")]
    #[command(after_help = "\
Taken: ODOMETRY, or LOCAL_POSITION_NED with ATTITUDE_QUATERNION or ATTITUDE;
thrust from ATTITUDE_TARGET, with --thrust-n. Sent: HEARTBEAT, TIMESYNC, and
what is asked for; without signatures. An estimate made from a vehicle's own
estimate is no second sensor: let no vehicle fuse what --send returns of its own
data.

Examples:
  # Any sender to this port: PX4, ArduPilot, or a router
  sim_publisher mavlink --listen udp:0.0.0.0:14550
  # On the vehicle's serial port, asking for 100 Hz; the thrust in newtons
  sim_publisher mavlink --listen serial:/dev/ttyUSB0:921600 \\
      --request-rate-hz 100 --thrust-n 39.2
  # The estimate back, to another program
  sim_publisher mavlink --listen udp:127.0.0.1:14550 --send odometry \\
      --send-to 127.0.0.1:14560 --send-rate-hz 30")]
    Mavlink(mavlink::MavlinkArgs),
    /// Bridges to a live vehicle; not in this program
    #[cfg(not(feature = "mavlink"))]
    Mavlink {
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
        _arguments: Vec<OsString>,
    },
}

/// Runs the program with these arguments, the program's name first.
pub fn main_with_args(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match command_line::parse::<Cli>(args) {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    let outcome = match cli.command {
        Command::Run(args) => run::run(&args),
        Command::Replay(args) => replay::replay(&args),
        Command::Dvl(args) => dvl::dvl(&args),
        Command::Inspect(args) => inspect::inspect(&args),
        #[cfg(feature = "mavlink")]
        Command::Mavlink(args) => mavlink::mavlink(&args),
        #[cfg(not(feature = "mavlink"))]
        Command::Mavlink { .. } => Err(target::Failure::Usage(
            "mavlink: the bridge is not in this program; needed: one with it: cargo run --release -p bench \
             --features mavlink -- sim_publisher mavlink …, or sim_publisher as it is built by default"
                .into(),
        )),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            logln!("sim_publisher: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    fn parsed(line: &str) -> Result<Cli, clap::Error> {
        Cli::try_parse_from(line.split_whitespace())
    }

    fn code_of(line: &str) -> ExitCode {
        main_with_args(line.split_whitespace().map(OsString::from))
    }

    #[test]
    fn every_help_ends_in_examples_that_are_accepted() {
        Cli::command().debug_assert();
        assert_eq!(command_line::faults_of_help::<Cli>(), Vec::<String>::new());
    }

    #[test]
    fn wrong_words_are_refused_with_what_would_be_accepted() {
        for (line, expected) in [
            ("sim_publisher run", "--scenario"),
            ("sim_publisher run --scenario boat", "rigid-body"),
            ("sim_publisher run --scenario auv --outage 3", "needed: START:LENGTH"),
            ("sim_publisher run --scenario auv --velocity-bias-m-s 1,2", "three with commas"),
            ("sim_publisher replay --format xlsx f", "acsl"),
        ] {
            let message = parsed(line).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn wrong_usage_ends_with_code_two_before_anything_is_opened() {
        for line in [
            "sim_publisher",
            "sim_publisher run --scenario rigid-body --rate-hz 1",
            "sim_publisher run --scenario rotation --velocity-noise-m-s 0.1",
            "sim_publisher run --scenario auv --root relative",
            "sim_publisher run --scenario rigid-body --faults spiek@1:1",
            "sim_publisher run --scenario rigid-body --faults service-kill@1:1",
            "sim_publisher run --scenario rotation --faults bias@1:1,size=1",
            "sim_publisher run --scenario rigid-body --duration 5 --faults stop@5:1",
            "sim_publisher run --scenario auv --table dive.csv",
            "sim_publisher run --scenario auv --duration 9 --table dive.csv --faults kill@1:1",
            "sim_publisher replay --format acsl /no/such.log",
            "sim_publisher replay --format acsl /no/such.log --column time_s=t",
            "sim_publisher replay --format csv /no/such.csv --speed 0",
            "sim_publisher replay --format csv /no/such.csv --speed NaN",
            "sim_publisher mavlink",
            "sim_publisher mavlink --listen udp:14550",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --thrust-n 0",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --join-ms NaN",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --send-to 127.0.0.1:1",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --silent --send odometry",
            "sim_publisher mavlink --listen udp:127.0.0.1:0 --system-id 0",
            "sim_publisher mavlink --listen serial:/dev/null --send odometry --send-to 127.0.0.1:1",
        ] {
            assert_eq!(code_of(line), ExitCode::from(2), "{line}");
        }
        assert_eq!(code_of("sim_publisher --version"), ExitCode::SUCCESS);
    }
}
