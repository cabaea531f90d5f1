"""What light does in a scene: each module answers for the radiance along rays."""
