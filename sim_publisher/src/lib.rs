//! The vehicle's side of the service without a vehicle: a true plant with sensors and faults, or a recorded
//! flight, published as live samples.
//!
//! It depends on `shared_types`, and on two crates in its rooms: `importers` reads recorded flights, `mavlink_bridge` (a
//! Cargo feature) speaks to a live vehicle. It depends neither on the service nor on the observer: the true plant shares no
//! model and no integrator with them, so that the two cannot flatter each other.
//!
//! | module | holds |
//! |---|---|
//! | [`plant`] | a rigid body under a held command, RK4; what a nominal plant leaves out of it |
//! | [`scenario`] | four vehicles: the paper's two examples, a quadcopter, an underwater vehicle |
//! | [`disturbance`] | coloured noise: gusts, the variation of a current |
//! | [`sensors`] | what is measured of the truth, when, how badly, and which samples never arrive |
//! | [`delivery`] | what is on its way to the service |
//! | [`faults`] | what goes wrong on purpose, and when: a pure stage between samples and publication |
//! | [`simulation`] | all of them together: an iterator over samples, without clock or files |
//! | [`publish`] | samples into shared memory, each at its own stamp |
//! | [`supervise`] | the publishing process stopped, killed and started again, on purpose |
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
pub mod faults;
pub mod plant;
pub mod publish;
pub mod scenario;
pub mod sensors;
pub mod simulation;
pub mod supervise;

pub use cli::main_with_args;
pub use scenario::Scenario;
pub use simulation::{SimulatedSample, Simulation, SimulationError, SimulationOptions};

/// Whether the subcommand `mavlink` was built.
pub const HAS_MAVLINK: bool = cfg!(feature = "mavlink");
