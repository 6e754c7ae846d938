// A block must be searched when it or a neighbour towards larger x, y or z is marked: trilinear interpolation reads one
// voxel further.

@compute @workgroup_size(GROUP_X, GROUP_Y)
fn dilate_blocks(@builtin(global_invocation_id) id: vec3u) {
    let blocks = parameters.blocks;
    let x = i32(id.x);
    let line = i32(id.y);
    if ((parameters.conditional != 0 && state.tracked == 0) || x >= blocks || line >= blocks * blocks) {
        return;
    }
    let y = line % blocks;
    let z = line / blocks;
    var marked = 0;
    for (var k = 0; k < 8; k++) {
        let place = min(vec3i(x + (k & 1), y + ((k >> 1u) & 1), z + (k >> 2u)), vec3i(blocks - 1));
        marked |= surface[(place.z * blocks + place.y) * blocks + place.x];
    }
    searched[line * blocks + x] = marked;
}
