// Emitters whose shadows are convolved. Needs frame.wgsl. Host twin: pass::layout::FrameParameters::is_soft.

fn is_soft(emitter: u32) -> bool {
    var found = false;
    for (var k = 0u; k < frame.soft.x; k += 1u) {
        found = found || frame.soft_emitters[k / 4u][k & 3u] == emitter;
    }
    return found;
}
