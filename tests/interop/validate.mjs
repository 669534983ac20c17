// Khronos' validator has nothing to say but that it does not know the names of KHR_gaussian_splatting.
import fs from 'node:fs';
import validator from 'gltf-validator';

const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])), { maxIssues: 0 });
const isKnown = (m) => m.code === 'MESH_PRIMITIVE_INVALID_ATTRIBUTE' && /KHR_gaussian_splatting:/.test(m.pointer + m.message);
const unsupported = (m) => m.code === 'UNSUPPORTED_EXTENSION' && m.severity === 2;
const others = report.issues.messages.filter((m) => !isKnown(m) && !unsupported(m));
for (const m of others) console.log(`FAILED: severity ${m.severity}, ${m.code} at ${m.pointer}: ${m.message}`);
const count = (f) => report.issues.messages.filter(f).length;
console.log(`gltf-validator ${validator.version()}: ${count(isKnown)} names of KHR_gaussian_splatting and ${count(unsupported)} extensions it does not know, ${others.length} other messages`);
process.exit(others.length ? 1 : 0);
