// Parameters of one pass of the renderer, written at its start. Host twin: pass::layout::FrameParameters.
struct FrameParameters {
    eye: vec4<f32>,             // eye point; w: coordinate scale of the scene (for ray-origin offsets)
    right: vec4<f32>,           // image half width at unit distance, orthographic: at any; w: clip distance squared
    up: vec4<f32>,              // image half height likewise; w: clip distance
    forward: vec4<f32>,         // unit view direction; w: distance beyond every surface (directional lights)
    bounds_min: vec4<f32>,      // lower corner of the scene; w: 1 / maximum extent
    pixel_offset: vec4<f32>,    // offset of the sample in its pixel, [0,1)^2; z: minimum alpha of a light's lobe; w: irradiance that may be dropped
    size: vec4<u32>,            // width, height, pixels, index of the pass within its instance
    within: vec4<u32>,          // place of the view in the whole image, width and height of the whole image
    walk: vec4<u32>,            // first index of the sequence segment, N of a class, window rotation, delta lights
    keys: vec4<u32>,            // key of the pass, key of the instance, bits (1 jitter, 2 Sobol' points, 4 shared photons), instance
    scene: vec4<u32>,           // nodes, emitters, maximum path length, 0 (unknown to compilers, see exact_sum.wgsl)
    pattern: vec4<u32>,         // width and height of the interleaving pattern, classes, lights of each class
    photons: vec4<u32>,         // caustic photons of each class N, first index of their sequence, targets, buckets - 1 (a power of 2)
    photon: vec4<f32>,          // radius r of the look-up, 1 / (2r), 1 / (pi r^2 N), bits of the photons of a class that start from emitters
    depths: array<vec4<u32>, 16>,   // for j reflections: particles N_j, first light slot, bits of 1/N_j, N_(j+1)
    shifts: array<vec4<f32>, 16>,   // for j: Cranley-Patterson shifts of dimensions 2j, 2j+1; z, w: bits of their bases
    sobol: array<vec4<u32>, 16>,    // for j: random words of dimensions 2j, 2j+1; z, w: Sobol' point of the gather rays of bounce j
    choice: vec4<f32>,          // fraction of emitter samples still chosen by power where contributions choose (defensive sampling); virtual
                                // lights on a unit of area of an emitter of radiance 1, and of other surfaces; greatest alpha of a lobe that
                                // eye paths follow, 0: none
    superposition: vec4<u32>,   // number of planar reflectors handled by superposition; form of their reflectance (settings::Reflectance);
                                // 1: images with depth show what they mirror; bits of the alpha above which splats show lobes, 0: none
    mirrors: vec4<u32>,         // mirrored lights of each class N, lights to mirror, planar mirrors M; neighbours of a class that share near light
    lists: vec4<u32>,           // lights that a cluster chooses from the lights after reflections of its class, lights of a cluster; bits of the weight of near light of the same class;
                                // 1 + the only particle whose path begins in this pass, 0: all do
    lens: vec4<f32>,            // aperture diameter times the pixels of a unit of length at unit distance, 1 / focus distance; z: weight of neighbours;
                                // w: photons in a footprint, 0: all have radius r
    cones: vec4<f32>,           // widths that textures are averaged over: of a pixel at unit depth (orthographic: at any), of particles and of gather rays at unit
                                // distance; w: probability that a particle survives a reflection, 0: all do (see ring.rs)
    shift: vec4<f32>,           // displacement of the image's centre from the view direction, in half widths and half heights; z: 1 if the camera is orthographic, else 0; w: 1 / number of the pass, from 1: weight of sparse windows
    soft: vec4<u32>,            // number of emitters whose shadows are convolved (see soft_shadow.rs); zeros
    soft_emitters: array<vec4<u32>, 2>, // their numbers
    task: array<vec4<u32>, 2>,  // pixels that take part: first column and row, end of columns and rows; 1, or 0: all do; 1 + their class, 0: all
}
