"""What a solution says: figures of contact, resultants, violated assumptions."""
