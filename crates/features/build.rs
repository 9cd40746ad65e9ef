//! Without a build script Cargo would not regard the dependencies of build scripts.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
}
