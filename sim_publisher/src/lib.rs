//! Publishes live samples in place of a vehicle: a simulated true plant with sensors and faults, or a recorded flight.
//!
//! Depends on `shared_types`, `command_line`, and two crates in its folder: `importers` reads recorded flights, and
//! `mavlink_bridge` (a Cargo feature) connects to a live vehicle. It depends neither on the service nor on the observer: the
//! true plant shares no model and no integrator with them, so a common error cannot make the estimates look better.
//!
//! | module | holds |
//! |---|---|
//! | [`plant`] | a rigid body under a held command, integrated by RK4; the forces that a nominal plant omits |
//! | [`scenario`] | four vehicles: the paper's two examples, a quadcopter, an underwater vehicle |
//! | [`disturbance`] | coloured noise: gusts, the variation of a current |
//! | [`sensors`] | measurements of the truth: errors, instants, dropouts |
//! | [`sensor_set`] | sensors of several processes, each with its rate, delay and place |
//! | [`delivery`] | what is on its way to the service |
//! | [`faults`] | injected faults: a pure stage between samples and publication |
//! | [`simulation`] | an iterator over samples of plant, sensors and faults, without clock or files |
//! | [`dvl`] | a Doppler log over TCP as samples |
//! | [`publish`] | publishing samples in shared memory, each at its stamp |
//! | [`supervise`] | stopping, killing and restarting the publishing process, as a fault |
//! | [`cli`] | the command line; no other file imports it |
//!
//! ```
//! use sim_publisher::{Scenario, Simulation, SimulationOptions};
//!
//! let options = SimulationOptions { duration_s: Some(1.0), ..SimulationOptions::of(Scenario::RigidBody) };
//! let speed_m_s = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
//! for sample in Simulation::new(&options)? {
//!     let (truth, measured) = (sample.truth, sample.measurement.expect("nothing is dropped by default"));
//!     assert!((speed_m_s(truth.velocity_m_s) - speed_m_s(measured.velocity_m_s)).abs() < 0.2);
//! }
//! # Ok::<(), sim_publisher::SimulationError>(())
//! ```

pub mod cli;
pub mod delivery;
pub mod disturbance;
pub mod dvl;
pub mod faults;
pub mod plant;
pub mod publish;
pub mod scenario;
pub mod sensor_set;
pub mod sensors;
pub mod simulation;
pub mod supervise;

pub use cli::main_with_args;
pub use scenario::Scenario;
pub use sensor_set::{SENSOR_SETS, SensorSet};
pub use simulation::{SimulatedSample, Simulation, SimulationError, SimulationOptions};

/// Whether the subcommand `mavlink` was built.
pub const HAS_MAVLINK: bool = cfg!(feature = "mavlink");
