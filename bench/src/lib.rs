//! Measures the observer and the service. The figures in the project's documents come from these commands; for a command
//! that has been removed, the document names the last commit that contains it. Depends on the service, the simulator and the
//! importers; no other crate depends on this one.
//!
//! | module | command | measures |
//! |---|---|---|
//! | `demo` | `bench demo` | errors of the whole system: service and simulated vehicle as two processes |
//! | [`paper`] | `bench paper` | errors in the paper's two examples, with their table and figures |
//! | `sensors` | `bench sensors` | accuracy with late sensors of several processes |
//! | `hover` | `bench hover` | what the sensor's noise alone teaches the gradient law |
//! | `step` | `bench step` | latency of a step as the number of centers grows |
//! | `ipc` | `bench ipc` | a round trip through the service, beside one through bare shared memory |
//! | `service` | `bench service` | a sample's stamp to its estimate, by trigger and rate |
//! | `jitter` | `bench jitter` | how late the service's cycle wakes up, beside cyclictest |
//! | `load` | `bench load` | the cost of further readers and further vehicles |
//! | `soak` | `bench soak` | a long run on a loaded machine: losses, memory |
//! | `accuracy` | `bench accuracy` | accuracy on many flights, beside other estimators |
//! | `flights` | `bench replay`, `bench tune` | accuracy on a recorded flight; a configuration for it |
//!
//! They share `harness` (processes, exchange, quantiles, tables), `plot` (figures as SVG) and `kalman` (the filter of the
//! comparisons). A measurement imports these and no other measurement; [`cli`], the command line, imports all.

mod accuracy;
pub mod cli;
mod demo;
mod disturbance_filter;
mod flights;
mod harness;
mod hover;
mod ipc;
mod jitter;
mod kalman;
mod load;
pub mod paper;
mod plot;
mod sensors;
mod service;
mod soak;
mod step;
