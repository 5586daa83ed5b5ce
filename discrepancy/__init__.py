"""Model against measurement: where the model fails, and which effect it lacks."""
