//! The programs as users meet them.

mod animate;
mod bench;
mod flags;
mod general;
mod render;
