//! The programs as users meet them.

mod animate;
mod bake;
mod bench;
mod flags;
mod general;
mod live;
mod render;
#[cfg(feature = "viewer")]
mod view;
