//! The passes of a frame, in frame order.

pub mod layout;
