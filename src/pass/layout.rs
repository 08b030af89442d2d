//! The structures that passes share with their kernels; the build checks each against its twin in WGSL.
