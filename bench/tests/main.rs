//! The commands of `bench` as users run them, and the product as a whole: service, simulator and bridge as real processes.
//!
//! All tests are in one program, which is linked once, except `regression`, which checks every estimate to the bit. Tests
//! that need a processor of their own are listed in `.config/nextest.toml`. Tests that take long are ignored, with a reason.

mod commands;
mod documents;
mod dvl;
mod faults;
mod latency;
mod logs;
mod mavlink;
mod paper;
mod programs;
mod record;
mod reference_figures;
mod three_processes;
