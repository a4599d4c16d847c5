//! How the shared library is linked.

fn main() {
    // A program asks for this name when it starts, and so never gets another major version.
    let major = env!("CARGO_PKG_VERSION_MAJOR");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libobserver_client.so.{major}");
    // Only the functions of the header are seen; iceoryx2 has a symbol for the linker, too.
    println!("cargo::rustc-cdylib-link-arg=-Wl,--exclude-libs,ALL");
    println!("cargo::rerun-if-changed=build.rs");
}
