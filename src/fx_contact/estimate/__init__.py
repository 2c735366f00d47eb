"""How large the error is and where: recovery, effectivity, marking, dual solutions for the forces of contact."""
