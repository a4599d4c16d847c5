//! Names the shared library for the loader: a program built with `libobserver_client.so` asks for
//! `libobserver_client.so.0` when it starts, and never gets another major version.

fn main() {
    let major = env!("CARGO_PKG_VERSION_MAJOR");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libobserver_client.so.{major}");
    println!("cargo::rerun-if-changed=build.rs");
}
