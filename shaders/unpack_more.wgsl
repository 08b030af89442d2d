// Words of a task's pixels in a further array. See pass/unpack_more.rs.
#include "packed.wgsl"

@group(0) @binding(1) var<storage, read_write> further: array<u32>;

// Host twin: pass::layout::UnpackMorePush.
struct UnpackMorePush {
    first: u32,     // first word: if there is a list, numbers of pixels; then their words, the first of all of them first
    count: u32,     // pixels
    words: u32,     // of a pixel
    is_listed: u32, // 1 if there is a list, 0 if all pixels of the task have words
    grid: u32,      // first word of the task's grid
    width: u32,     // of the image
    begin: u32,     // first word of the array in its buffer
}
var<immediate> push: UnpackMorePush;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = (group.x + group.y * groups.x) * 64u + lane;
    if i >= push.count * push.words {
        return;
    }
    let k = i / push.words;
    let word = i % push.words;
    var number = k;
    var columns = push.first;
    if push.is_listed == 1u {
        number = packed[push.first + k];
        columns += push.count;
    }
    let at = pixel_of(push.grid, number);
    further[push.begin + (at.x + at.y * push.width) * push.words + word] = packed[columns + word * push.count + k];
}
