//! The integration tests of the monitor, in one program, which is linked once: made-up models, real services, and public
//! readers of its files.
//!
//! Cargo builds `monitor` for these tests, but neither the service nor the simulator. This program runs as either of them
//! (`testkit::Program::played`).

mod across_domains;
mod lines;
mod mcap;
mod programs;
mod remote;
mod terminal;
mod view;

#[test]
fn role() {
    testkit::play_role(&[
        ("daemon", |arguments| daemon::cli::main_with_args(arguments)),
        ("sim_publisher", |arguments| sim_publisher::main_with_args(arguments)),
    ]);
}
