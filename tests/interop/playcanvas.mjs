// PlayCanvas: the properties of its splats. Its COLOR_0 is for points.
import { readGlb, attribute, expectAttributes, lookNames } from './glb.mjs';

const { version, NullGraphicsDevice, GSplatData } = await import('playcanvas');
const { khrGaussianSplatting } = await import('playcanvas/build/playcanvas/src/framework/parsers/glb/extensions/khr-gaussian-splatting.js');

const glb = readGlb(process.argv[2]);
let data = null;
GSplatData.prototype.reorderData = function () { data = this; throw new Error('read'); }; // what follows is the order and the textures
const views = glb.json.bufferViews.map((view) => {
    const bytes = new Uint8Array(glb.bin.subarray(view.byteOffset ?? 0, (view.byteOffset ?? 0) + view.byteLength)).slice();
    bytes.byteStride = view.byteStride; // as its createBufferViews does
    return bytes;
});
try { khrGaussianSplatting.createResources(null, glb.json, views); } catch (e) { if (e.message !== 'read') throw e; }
if (!data) console.log('FAILED: PlayCanvas makes no splats of it'), process.exit(1);

const zip = (...names) => {
    const columns = names.map((name) => data.getProp(name));
    return Array.from({ length: data.numSplats * names.length }, (_, i) => columns[i % names.length]?.[Math.floor(i / names.length)]);
};
const K = 'KHR_gaussian_splatting:';
const found = { POSITION: zip('x', 'y', 'z'), [K + 'ROTATION']: zip('rot_1', 'rot_2', 'rot_3', 'rot_0'), [K + 'SCALE']: zip('scale_0', 'scale_1', 'scale_2'),
    [K + 'OPACITY']: zip('opacity'), [K + 'SH_DEGREE_0_COEF_0']: zip('f_dc_0', 'f_dc_1', 'f_dc_2') };
for (let degree = 1, k = 0; degree <= 3; ++degree)
    for (let c = 0; c < 2 * degree + 1; ++c, ++k) found[`${K}SH_DEGREE_${degree}_COEF_${c}`] = zip(`f_rest_${k}`, `f_rest_${15 + k}`, `f_rest_${30 + k}`);
expectAttributes(glb, found, `PlayCanvas ${version}`, lookNames(glb).filter((name) => name !== 'COLOR_0'));
