"""Where matter is: density fields, and the components that join a field with an optical model."""
