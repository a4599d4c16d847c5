//! `sim_publisher mavlink`: publishes a live vehicle's messages as samples, and sends the estimate back.

use super::arguments::parse_axes;
use super::target::{Failure, TargetArgs, connected};
use clap::{Args, ValueEnum};
use command_line::stop_flag;
use mavlink_bridge::{Address, Link, MavlinkError, Options, Settings, Source};
use shared_types::{logln, outln};

/// MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY.
const OWN_COMPONENT_ID: u8 = 197;

/// What is sent of the estimate.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum SendArg {
    /// ODOMETRY: pose, velocities along the body's axes, covariance unknown
    Odometry,
}

#[derive(Debug, Clone, Copy, Default, ValueEnum)]
enum SourceArg {
    /// ODOMETRY where it comes, else the others
    #[default]
    Auto,
    /// ODOMETRY alone
    Odometry,
    /// LOCAL_POSITION_NED with ATTITUDE_QUATERNION or ATTITUDE
    LocalPosition,
}

#[derive(Debug, Args)]
pub(super) struct MavlinkArgs {
    /// Where the vehicle is: udp:ADDRESS:PORT, udpout:HOST:PORT or serial:DEVICE[:BAUD]
    #[arg(long, value_name = "ADDRESS")]
    listen: Address,
    /// The vehicle's system id [default: the first autopilot heard]
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u8).range(1..))]
    system_id: Option<u8>,
    /// The component that is listened to
    #[arg(long, value_name = "ID", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..))]
    component_id: u8,
    /// Which messages are taken
    #[arg(long, value_enum, default_value_t)]
    source: SourceArg,
    /// Position and attitude of times that differ by no more than this are one sample
    #[arg(long, value_name = "MS", default_value_t = 5.0)]
    join_ms: f64,
    /// Force of a thrust set-point of 1 [default: no force]
    #[arg(long, value_name = "N")]
    thrust_n: Option<f64>,
    /// Torque of a torque set-point of 1: one number, or three with commas [default: no torque]
    #[arg(long, value_name = "N_M", value_parser = parse_axes)]
    torque_n_m: Option<[f64; 3]>,
    /// Send the estimate back
    #[arg(long, value_enum, value_name = "MESSAGE")]
    send: Option<SendArg>,
    /// Where to (udp) [default: to the vehicle that talks]
    #[arg(long, value_name = "HOST:PORT", requires = "send")]
    send_to: Option<String>,
    /// How often at most
    #[arg(long, value_name = "HZ", default_value_t = 50.0, requires = "send")]
    send_rate_hz: f64,
    /// System id of what is sent [default: the vehicle's]
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u8).range(1..))]
    own_system_id: Option<u8>,
    /// Component id of what is sent [default: visual-inertial odometry]
    #[arg(long, value_name = "ID", default_value_t = OWN_COMPONENT_ID, value_parser = clap::value_parser!(u8).range(1..))]
    own_component_id: u8,
    /// Ask the vehicle for the messages at this rate [default: take what comes]
    #[arg(long, value_name = "HZ")]
    request_rate_hz: Option<f64>,
    /// Send nothing at all, not even a heartbeat
    #[arg(long, conflicts_with_all = ["send", "request_rate_hz"])]
    silent: bool,
    /// Length of the run in s [default: until Ctrl-C]
    #[arg(long, visible_alias = "duration", value_name = "S")]
    duration_s: Option<f64>,
    #[command(flatten)]
    target: TargetArgs,
}

impl MavlinkArgs {
    /// # Errors
    /// `Usage` with what was found and what is needed.
    fn options(&self) -> Result<Options, Failure> {
        let torques = self.torque_n_m.iter().flatten().map(|torque| ("torque-n-m", Some(*torque), 0.0, 1e9));
        let given = [
            ("join-ms", Some(self.join_ms), 0.0, 1000.0),
            ("thrust-n", self.thrust_n, f64::MIN_POSITIVE, 1e9),
            ("send-rate-hz", Some(self.send_rate_hz), 0.1, 1000.0),
            ("request-rate-hz", self.request_rate_hz, 0.1, 1000.0),
            ("duration-s", self.duration_s, f64::MIN_POSITIVE, 1e9),
        ];
        for (name, number, low, high) in given.into_iter().chain(torques) {
            let Some(number) = number.filter(|number| !(low..=high).contains(number)) else { continue };
            let low = if low == f64::MIN_POSITIVE { "above 0".into() } else { format!("{low} or more") };
            return Err(Failure::Usage(format!("--{name} {number}: needed: {low}, at most {high}")));
        }
        if self.send_to.is_some() && matches!(self.listen, Address::Serial { .. }) {
            return Err(Failure::Usage("--send-to: a serial line leads to one place; leave it out".into()));
        }
        Ok(Options {
            listen: self.listen.clone(),
            settings: Settings {
                system_id: self.system_id,
                component_id: self.component_id,
                source: match self.source {
                    SourceArg::Auto => Source::Auto,
                    SourceArg::Odometry => Source::Odometry,
                    SourceArg::LocalPosition => Source::LocalPosition,
                },
                join_ns: (self.join_ms * 1e6) as u64,
                thrust_n: self.thrust_n,
                torque_n_m: self.torque_n_m,
                request_rate_hz: self.request_rate_hz,
            },
            sends_odometry: self.send.is_some(),
            send_to: self.send_to.clone(),
            send_rate_hz: self.send_rate_hz,
            own_system_id: self.own_system_id,
            own_component_id: self.own_component_id,
            is_silent: self.silent,
            duration_s: self.duration_s,
        })
    }
}

/// Takes from a live vehicle until the end, and gives the estimate back.
pub(super) fn mavlink(args: &MavlinkArgs) -> Result<(), Failure> {
    let (options, target) = (args.options()?, &args.target);
    // First: a wire that cannot be used is reported before the wait for the service.
    let link = Link::open(&options.listen).map_err(MavlinkError::from)?;
    let stop = stop_flag()?;
    let Some((domain, client)) = connected(target, &stop)? else { return Ok(()) };
    logln!("{} to instance '{}' in {}", options.listen, target.instance, domain.root().display());
    let bridged = mavlink_bridge::run(&options, link, &client, &stop)?;
    drop(client);
    domain.remove_if_unused()?;
    match target.json {
        true => outln!("{}", bridged.document()),
        false => outln!("{}", bridged.line()),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: MavlinkArgs,
    }

    #[test]
    fn options_become_settings() {
        let settings =
            |line: &str| Line::parse_from(line.split_whitespace()).args.options().unwrap().settings;
        let line = "x --listen udp:0.0.0.0:14550 --system-id 4 --component-id 2 --source local-position --join-ms 2.5 \
                    --thrust-n 40 --torque-n-m 1,2,3 --request-rate-hz 20";
        let expected = Settings {
            system_id: Some(4),
            component_id: 2,
            source: Source::LocalPosition,
            join_ns: 2_500_000,
            thrust_n: Some(40.0),
            torque_n_m: Some([1.0, 2.0, 3.0]),
            request_rate_hz: Some(20.0),
        };
        assert_eq!(settings(line), expected);
        assert_eq!(settings("x --listen udp:0.0.0.0:14550"), Settings::default());
    }
}
