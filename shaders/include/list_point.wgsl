// Lists shading points. Needs work.wgsl. The shader binds `list_out` and `work_out`.

// Puts a lit shading point on the list: at `place` where the list is `ordered`, which has a place for each slot, else at the end.
fn list_point(slot: u32, lit: bool, ordered: bool, place: u32) {
    var at = place;
    // The count does not depend on the order of the invocations; a list that is appended to does.
    if lit {
        let appended = atomicAdd(&work_out.live, 1u);
        at = select(appended, place, ordered);
    }
    if lit || ordered {
        list_out[at] = select(NO_POINT, slot, lit);
    }
}
