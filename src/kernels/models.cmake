# The materials that are built. Each has a header
# include/mpm/physics/material/<snake_case_name>.hpp; adding one here gives it an instantiation unit
# per backend.
set(MPM_MODELS TaitFluid HerschelBulkleyFluid FixedCorotated NeoHookean StVenantKirchhoffHencky
               LinearElastic VonMises DruckerPrager CamClay Hypoelastic)
# Of these the CPU's unit is compiled in four parts, side by side: one alone takes longer than all of
# the build on many cores.
set(MPM_LONG_MODELS TaitFluid HerschelBulkleyFluid)
