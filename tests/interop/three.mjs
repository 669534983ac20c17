// three.js: what GLTFLoader hands to its extension for splats, and what the splats become.
import { readGlb, attribute, expectAttributes, lookNames } from './glb.mjs';
import fs from 'node:fs';

globalThis.self ??= globalThis;
const { REVISION } = await import('three');
const { GLTFLoader } = await import('three/addons/loaders/GLTFLoader.js');
const { GLTFGaussianSplatLoaderExtension } = await import('three/addons/loaders/GLTFGaussianSplatLoaderExtension.js');

const glb = readGlb(process.argv[2]);
const file = fs.readFileSync(process.argv[2]);
const found = {};
const loader = new GLTFLoader();
loader.register((parser) => {
    const load = parser.loadGeometries.bind(parser);
    parser.loadGeometries = async (primitives) => {
        const geometries = await load(primitives);
        const names = { POSITION: 'position', COLOR_0: 'color' };
        for (const name of lookNames(glb)) {
            const a = geometries[0].getAttribute(names[name] ?? name.toLowerCase());
            if (a) found[name] = Array.from({ length: a.count * a.itemSize }, (_, i) => a.getComponent(Math.floor(i / a.itemSize), i % a.itemSize));
        }
        return geometries;
    };
    return new GLTFGaussianSplatLoaderExtension(parser);
});
const { scene } = await loader.parseAsync(file.buffer.slice(file.byteOffset, file.byteOffset + file.length), '');
expectAttributes(glb, found, `three.js r${REVISION}`);

let splats = null;
scene.traverse((object) => { if (object.isGaussianSplat) splats = object; });
if (!splats) console.log('FAILED: three.js makes no GaussianSplat of it'), process.exit(1);
const centers = splats.splatGeometry.getAttribute('position').array, wanted = attribute(glb, 'POSITION');
if (wanted.some((x, i) => x !== centers[i])) console.log('FAILED: three.js puts the splats elsewhere'), process.exit(1);
if (!splats.splatGeometry.getAttribute('sphericalHarmonics3')) console.log('FAILED: three.js shows no spherical harmonics of degree 3'), process.exit(1);
