"""Pictures of a maze: demonstrations, what was driven, what the models believe where, and the final policy."""
