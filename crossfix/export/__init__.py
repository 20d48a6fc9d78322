"""Recordings in the formats of others: viewers, spreadsheets, globes."""
