// Renders skies with the package's own loader and material, and posts what it has read back.
import { AtmosphereParameters, PrecomputedTexturesLoader, SkyMaterial } from '@takram/three-atmosphere'
import { FloatType, Mesh, PerspectiveCamera, PlaneGeometry, Scene, Vector3, WebGLRenderTarget, WebGLRenderer } from 'three'

const SIZE = 12

async function run() {
  const cases = await (await fetch('cases.json')).json()
  const made = await (await fetch('sky/atmosphere.json')).json()
  const atmosphere = new AtmosphereParameters(made.atmosphere)
  const renderer = new WebGLRenderer()
  const textures = await new PrecomputedTexturesLoader(made.loader).setType(renderer).loadAsync('sky')
  // A sky, and what the shaders of the package say of light on level ground where the camera is.
  const ground = output => `void main() {
    vec3 sky, sun = GetSunAndSkyIrradiance(vCameraPosition, normalize(vCameraPosition), sunDirection, sky);
    outputColor = vec4(${output}, 1.0);
  }`
  const [material, sunlight, skylight] = [null, ground('sun'), ground('sky')].map(main => {
    const made = new SkyMaterial({ ...textures, sun: false, moon: false, correctAltitude: false })
    // The material's constructor knows the Earth of its package only.
    made.uniforms.ATMOSPHERE = atmosphere.toUniform()
    made.uniforms.SUN_SPECTRAL_RADIANCE_TO_LUMINANCE.value = atmosphere.sunRadianceToRelativeLuminance
    made.uniforms.SKY_SPECTRAL_RADIANCE_TO_LUMINANCE.value = atmosphere.skyRadianceToRelativeLuminance
    if (main != null) made.fragmentShader = made.fragmentShader.replace(/void main\(\)[\s\S]*$/, main)
    return made
  })
  const mesh = new Mesh(new PlaneGeometry(2, 2))
  mesh.frustumCulled = false
  const scene = new Scene().add(mesh)
  const target = new WebGLRenderTarget(SIZE, SIZE, { type: FloatType, depthBuffer: false })
  return cases.map(({ altitude, sun, look, fov }) => {
    const camera = new PerspectiveCamera(fov, 1, 1, 1e8)
    camera.up.set(0, 0, 1)
    camera.position.set(0, 0, made.atmosphere.bottomRadius + altitude)
    camera.lookAt(camera.position.clone().add(new Vector3(...look)))
    camera.updateMatrixWorld()
    const shown = by => {
      mesh.material = by
      by.sunDirection.set(...sun)
      renderer.setRenderTarget(target)
      renderer.render(scene, camera)
      const pixels = new Float32Array(SIZE * SIZE * 4)
      renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, pixels)
      return Array.from(pixels)
    }
    const directions = []
    for (let row = 0; row < SIZE; ++row) {
      for (let column = 0; column < SIZE; ++column) {
        const point = new Vector3(((column + 0.5) / SIZE) * 2 - 1, ((row + 0.5) / SIZE) * 2 - 1, 0)
        directions.push(point.unproject(camera).sub(camera.position).normalize().toArray())
      }
    }
    const [pixels, beam, sky] = [material, sunlight, skylight].map(shown)
    return { pixels, directions, beam: beam.slice(0, 3), sky: sky.slice(0, 3) }
  })
}

run().then(
  found => fetch('found', { method: 'POST', body: JSON.stringify({ found }) }),
  error => fetch('found', { method: 'POST', body: JSON.stringify({ error: String(error?.stack ?? error) }) })
)
