//! Measurement of the observer and of the service around it. The figures in the project's documents come from these
//! commands; where a command is gone, the document names the commit that had it.
//!
//! | room | command | measures |
//! |---|---|---|
//! | `demo` | `bench demo` | the whole job: service and simulated vehicle as two processes |
//! | [`paper`] | `bench paper` | the paper's two examples: table, figures, errors |
//! | `step` | `bench step` | latency of a step as the number of centers grows |
//! | `ipc` | `bench ipc` | a round trip through the service, beside one through bare shared memory |
//! | `service` | `bench service` | a sample's stamp to its estimate, by trigger and rate |
//! | `jitter` | `bench jitter` | how late the service's cycle wakes up, beside cyclictest |
//! | `load` | `bench load` | what further readers and further vehicles cost |
//! | `soak` | `bench soak` | a long run on a loaded machine: losses, memory |
//! | `flights` | `bench replay`, `bench tune` | accuracy on a recorded flight; a configuration for it |
//!
//! They share `harness` (processes, exchange, quantiles, tables), `plot` (figures as SVG) and `kalman` (the filter that
//! is compared with). A measurement imports these and no other measurement; [`cli`], the command line, imports all.

pub mod cli;
mod demo;
mod flights;
mod harness;
mod ipc;
mod jitter;
mod kalman;
mod load;
pub mod paper;
mod plot;
mod service;
mod soak;
mod step;
