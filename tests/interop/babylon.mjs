// Babylon.js: what its extension for splats reads, on an engine that draws nothing.
import { readGlb, attribute, expectAttributes, lookNames, splatsOf } from './glb.mjs';
import fs from 'node:fs';

globalThis.XMLHttpRequest ??= class {}; // browsers' only; the file is in memory
const { NullEngine, Scene, Engine, LoadAssetContainerAsync, GaussianSplattingMesh } = await import('@babylonjs/core');
const { GLTFLoader } = await import('@babylonjs/loaders/glTF/2.0/index.js');

const glb = readGlb(process.argv[2]);
const found = {}, buffers = [];
const read = GLTFLoader.prototype._loadFloatAccessorAsync;
GLTFLoader.prototype._loadFloatAccessorAsync = async function (context, accessor) {
    const values = await read.call(this, context, accessor);
    for (const name of lookNames(glb)) if (splatsOf(glb).attributes[name] === accessor.index) found[name] = values;
    return values;
};
// Sorting by depth needs a worker of browsers.
GaussianSplattingMesh.prototype.updateDataAsync = async (buffer) => { buffers.push(buffer); };
const scene = new Scene(new NullEngine());
await LoadAssetContainerAsync(new Uint8Array(fs.readFileSync(process.argv[2])), scene, { pluginExtension: '.glb' });
expectAttributes(glb, found, `Babylon.js ${Engine.Version}`);
if (buffers.length !== 1 || buffers[0].byteLength !== 32 * attribute(glb, 'KHR_gaussian_splatting:OPACITY').length)
    console.log('FAILED: Babylon.js makes no splats of it'), process.exit(1);
process.exit(0);
