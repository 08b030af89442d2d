// Lights by the lists of clusters or classes. Needs `lights` and `listed_lights`: of each entry the number of a light, and bits of the factor
// of what it emits.

// The light of an entry.
fn listed_light(entry: u32) -> PointLight {
    let listed = listed_lights[entry];
    let times = bitcast<f32>(listed.y);
    var l = lights[listed.x];
    l.emit = vec4<f32>(l.emit.xyz * times, l.emit.w);
    l.flux = vec4<f32>(l.flux.xyz * times, l.flux.w);
    return l;
}
