//! The programs as users meet them.

mod animate;
mod bake;
mod bench;
mod cluster;
mod conform;
#[cfg(target_os = "linux")]
mod drivers;
mod examples;
mod faults;
mod files;
mod flags;
mod general;
mod help;
mod live;
#[cfg(feature = "mpi")]
mod ranks;
mod render;
mod settings;
#[cfg(feature = "viewer")]
mod view;
