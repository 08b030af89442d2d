//! The positive control of GPU-assisted validation: a kernel that writes outside its buffer on purpose.
//!
//! `scripts/gpu_assisted.sh` runs it, and then the checks of all kernels under the same layer.

use lightsum::conform::checks::kernels::fill_push;
use lightsum::gpu::{Buffer, Context, ContextOptions, Kernel, Memory};

use crate::support::{kernels, options};

#[test]
#[ignore = "writes outside a buffer; needs a validation layer with GPU-assisted validation: scripts/gpu_assisted.sh"]
fn a_write_outside_a_buffer_is_reported() {
    for no_texel_buffers in [true, false] {
        let ctx = Context::headless(&ContextOptions { no_texel_buffers, ..options() }).unwrap();
        let kernel = Kernel::new(&ctx, &kernels::FILL).unwrap();
        let fill = |count: usize| {
            let values = Buffer::new(&ctx, "values", 64 * 4, Memory::Device).unwrap();
            // Memory of ours behind it, so that the write does no harm where nobody checks it.
            let _behind = Buffer::new(&ctx, "behind", 1 << 16, Memory::Device).unwrap();
            let bindings = kernel.bind(&[("values", (&values).into())]).unwrap();
            let push = fill_push(count, 1);
            ctx.submit_and_wait("fill", None, |rec| {
                rec.fill(&values, 0)?;
                rec.dispatch(&kernel, &bindings, bytemuck::bytes_of(&push), count.div_ceil(64) as u64)
            })
            .unwrap();
            ctx.take_messages()
        };
        let about_bounds =
            |messages: Vec<String>| messages.into_iter().filter(|m| m.contains("out of bounds")).collect::<Vec<_>>();
        assert_eq!(about_bounds(fill(64)), Vec::<String>::new(), "within the buffer");
        // Texel buffers are longer than what they hold.
        let found = about_bounds(fill(1024));
        println!("texel buffers {}: {} messages, first {:?}", !no_texel_buffers, found.len(), found.first());
        assert!(!found.is_empty(), "the layer does not see a write outside of a buffer");
    }
}
