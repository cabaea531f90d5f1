"""Where matter is: density fields, and the components that join a field with an optical model."""

# Fields are added and multiplied by what stands on all of them.
import skyscatter.media.operations  # noqa: F401
