// Renders skies with the package's own loader and material, and posts what it has read back.
import { AtmosphereParameters, PrecomputedTexturesLoader, SkyLightProbe, SkyMaterial, getSunLightColor } from '@takram/three-atmosphere'
import { Color, FloatType, Mesh, PerspectiveCamera, PlaneGeometry, Scene, Vector3, WebGLRenderTarget, WebGLRenderer } from 'three'

const SIZE = 12

async function run() {
  const cases = await (await fetch('cases.json')).json()
  const made = await (await fetch('sky/atmosphere.json')).json()
  const atmosphere = new AtmosphereParameters(made.atmosphere)
  const renderer = new WebGLRenderer()
  const textures = await new PrecomputedTexturesLoader(made.loader).setType(renderer).loadAsync('sky')
  const material = new SkyMaterial({ ...textures, sun: false, moon: false, correctAltitude: false })
  // The material's constructor knows the Earth of its package only.
  material.uniforms.ATMOSPHERE = atmosphere.toUniform()
  material.uniforms.SUN_SPECTRAL_RADIANCE_TO_LUMINANCE.value = atmosphere.sunRadianceToRelativeLuminance
  material.uniforms.SKY_SPECTRAL_RADIANCE_TO_LUMINANCE.value = atmosphere.skyRadianceToRelativeLuminance
  const probe = new SkyLightProbe({ irradianceTexture: textures.irradianceTexture, correctAltitude: false }, atmosphere)
  const mesh = new Mesh(new PlaneGeometry(2, 2), material)
  mesh.frustumCulled = false
  const scene = new Scene().add(mesh)
  const target = new WebGLRenderTarget(SIZE, SIZE, { type: FloatType, depthBuffer: false })
  return cases.map(({ altitude, sun, look, fov }) => {
    const camera = new PerspectiveCamera(fov, 1, 1, 1e8)
    camera.up.set(0, 0, 1)
    camera.position.set(0, 0, made.atmosphere.bottomRadius + altitude)
    camera.lookAt(camera.position.clone().add(new Vector3(...look)))
    camera.updateMatrixWorld()
    material.sunDirection.set(...sun)
    renderer.setRenderTarget(target)
    renderer.render(scene, camera)
    const pixels = new Float32Array(SIZE * SIZE * 4)
    renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, pixels)
    const directions = []
    for (let row = 0; row < SIZE; ++row) {
      for (let column = 0; column < SIZE; ++column) {
        const point = new Vector3(((column + 0.5) / SIZE) * 2 - 1, ((row + 0.5) / SIZE) * 2 - 1, 0)
        directions.push(point.unproject(camera).sub(camera.position).normalize().toArray())
      }
    }
    probe.position.copy(camera.position)
    probe.updateMatrixWorld()
    probe.sunDirection.set(...sun)
    probe.update()
    const level = probe.sh.getIrradianceAt(new Vector3(0, 0, 1), new Vector3())
    const beam = getSunLightColor(textures.transmittanceTexture, camera.position, material.sunDirection, new Color(),
      { correctAltitude: false }, atmosphere)
    return { pixels: Array.from(pixels), directions, sky: level.toArray(), beam: beam.toArray() }
  })
}

run().then(
  found => fetch('found', { method: 'POST', body: JSON.stringify({ found }) }),
  error => fetch('found', { method: 'POST', body: JSON.stringify({ error: String(error?.stack ?? error) }) })
)
